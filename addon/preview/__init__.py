"""Live layers in 3D viewports.

`enable` and `disable` switch it on and off for a scene, `is_on` tells; `available` says why it cannot work
here; `draw` puts the picture into the viewport at hand, for the preview's own handler and for the engine, for
which `follow` and `unfollow` refine it; `state_of` tells what a viewport shows and what it cost, `layers_of`
what those of a scene could show, `failure` what keeps one from its picture. `observe` has all of it
told to a trace.
"""

from .control import (
    available,
    disable,
    draw,
    enable,
    failure,
    follow,
    is_on,
    layers_of,
    observe,
    register,
    state_of,
    unfollow,
    unregister,
)

__all__ = [
    "available",
    "disable",
    "draw",
    "enable",
    "failure",
    "follow",
    "is_on",
    "layers_of",
    "observe",
    "register",
    "state_of",
    "unfollow",
    "unregister",
]
