"""Where the preview's lines stand in a viewport: below Blender's own text."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from strata.addon.preview import caption


def view(**changes) -> tuple:
    """Space, region data and preferences as Blender has them at first."""
    overlay = {"show_overlays": True, "show_text": True, "show_stats": False, "show_floor": True}
    overlay |= dict.fromkeys(("show_axis_x", "show_axis_y", "show_axis_z"), False)
    preferences = {"show_view_name": True, "show_object_info": True, "show_playback_fps": True}
    region, shading = {"is_orthographic_side_view": False}, {"type": "SOLID"}
    for group in (overlay, preferences, region, shading):
        group.update({name: value for name, value in changes.items() if name in group})
    space = SimpleNamespace(overlay=SimpleNamespace(**overlay), shading=SimpleNamespace(**shading))
    return space, SimpleNamespace(**region), SimpleNamespace(**preferences)


@pytest.mark.parametrize(
    ("changes", "engine", "is_playing", "lines"),
    [
        ({}, "CYCLES", False, 2),
        ({"show_view_name": False}, "CYCLES", False, 1),
        ({"show_view_name": False}, "CYCLES", True, 2),  # frames a second in its place
        ({"show_view_name": False, "show_object_info": False}, "CYCLES", False, 0),
        ({"is_orthographic_side_view": True}, "CYCLES", False, 3),
        ({"is_orthographic_side_view": True, "show_floor": False}, "CYCLES", False, 2),
        ({"show_stats": True}, "CYCLES", False, 2 + caption.STATISTICS),
        ({"show_stats": True, "show_text": False}, "CYCLES", False, caption.STATISTICS),
        ({"show_stats": True, "show_overlays": False, "type": "RENDERED"}, "CYCLES", False, 0),
        ({"type": "RENDERED"}, "CYCLES", False, 3),
        ({"type": "RENDERED"}, "BLENDER_EEVEE", False, 4),
        ({"type": "MATERIAL"}, "CYCLES", False, 4),
    ],
)
def test_room_is_left_for_all_that_blender_writes(changes, engine, is_playing, lines):
    found = caption.lines_above(*view(**changes), engine, is_playing)
    assert found == (lines + caption.GAP if lines else 0)


def test_headers_and_toolbar_lie_over_a_region():
    def box(kind, x, y, width, height, alignment="NONE"):
        return SimpleNamespace(type=kind, x=x, y=y, width=width, height=height, alignment=alignment)

    region = box("WINDOW", 100, 50, 800, 600)
    header = box("HEADER", 100, 624, 800, 26, "TOP")
    second = box("TOOL_HEADER", 100, 598, 800, 26, "TOP")
    tools = box("TOOLS", 100, 50, 56, 548, "LEFT")
    assert caption.free_corner(region, [region, header, second, tools]) == (56, 548)
    hidden = box("TOOL_HEADER", 100, 598, 800, 1, "TOP")
    below = box("HEADER", 100, 50, 800, 26, "BOTTOM")
    above = box("HEADER", 100, 650, 800, 26, "TOP")  # beside, as without region overlap
    assert caption.free_corner(region, [region, hidden, below, above]) == (0, 600)
