"""Pictures as textures, in the colours that a viewport shows them in."""

from __future__ import annotations

from typing import Any

import bpy

from . import display, view_transform

MOST_TABLES = 4


class PictureTextures:
    """Of viewports, by region; and tables of the view transforms that they are shown through."""

    def __init__(self):
        self._shown: dict[int, tuple[Any, Any]] = {}  # a picture and how it is shown, and that as a texture
        self._tables: dict[tuple, Any] = {}  # by signature: arrays, then textures

    def draw(self, scene: bpy.types.Scene, region: bpy.types.Region, picture, is_overlay: bool) -> None:
        """Into the bound framebuffer."""
        style = (picture, is_overlay, None, 1.0)
        if is_overlay and picture.is_colour:
            style = (picture, True, self._table(scene), view_transform.exposure_factor(scene))
        made = self._shown.get(region.as_pointer())
        if made is None or any(a is not b and a != b for a, b in zip(made[0], style, strict=True)):
            shown = getattr(picture.pixels, "texture", None) or display.picture_texture(picture.pixels)
            if is_overlay or not picture.is_colour:
                shown = display.shown_texture(shown, len(picture.pixels.shape) == 2, *style[2:])
            made = self._shown[region.as_pointer()] = (style, shown)
        display.draw_picture(made[1], picture.place, (region.width, region.height), is_overlay)

    def read_view_transform(self, scene: bpy.types.Scene) -> bool:
        """Whether that of the scene had to be read."""
        signature = view_transform.signature(scene)
        if signature in self._tables:
            return False
        while len(self._tables) >= MOST_TABLES:
            del self._tables[next(iter(self._tables))]
        self._tables[signature] = view_transform.read(scene)
        return True

    def drop(self, region: int) -> None:
        """Frees what a region showed."""
        self._shown.pop(region, None)

    def clear(self) -> None:
        self._shown.clear()
        self._tables.clear()
        display.release()

    def _table(self, scene: bpy.types.Scene):
        """The texture of the scene's view transform; None until it has been read."""
        signature = view_transform.signature(scene)
        table = self._tables.get(signature)
        if hasattr(table, "shape"):
            table = self._tables[signature] = display.table_texture(table)
        return table
