"""Error against time: a scene baked with many settings and by rivals, all judged alike, and a page of it."""
