"""The preview's figures, written into a corner of the viewport."""

from __future__ import annotations

import blf
import numpy as np

from ..core.params import in_words
from ..measure.verdict import Verdict, advice, percent, verdict
from . import noise_map
from .viewport import Statistics

FONT = 0
COLOUR, SHADOW = (1.0, 1.0, 1.0, 0.9), (0.0, 0.0, 0.0, 0.8)
WIDGET_UNIT = 20.0  # pixels at an interface scale of 1
LINE = 1.6  # of a font's points: Blender's own distance of lines here
# What Blender writes there takes so many lines at most. Room is kept for all of them, so that the text stays
# where it is when another object is selected, or an engine has nothing to say.
STATISTICS = 5.6  # five rows and the gap above
GAP = 0.4  # between Blender's lines and these
ENGINE = {"BLENDER_EEVEE": 2.0}  # what it compiles, and what it lacks; others have one line


def lines(statistics: Statistics) -> list[str]:
    """What is on screen, what it cost, how noisy it is."""
    if statistics.message:
        return [f"Strata: {statistics.message}"]
    if statistics.samples:
        state = "converged" if statistics.is_converged else "refining"
        state = f"at its {in_words(statistics.out_of).lower()}" if statistics.out_of else state
        first = f"{state}, {statistics.samples} of {statistics.of_samples} samples"
    else:
        first = f"{statistics.frame_ms:.0f} ms, 1/{round(1.0 / statistics.scale)} resolution"
    found = [f"Strata: {first}"]
    if statistics.noise is not None:
        found.append(_told_noise(statistics))
    return found


def legend(statistics: Statistics) -> list[tuple[str, tuple[float, ...]]]:
    """Of a noise map: words and their colours, to be written beside each other."""
    if statistics.message:
        return []
    if not statistics.has_spread:
        why = "this is no mean of samples" if statistics.samples > 1 else "it takes 2 samples of each pixel"
        return [(f"no noise map: {why}", COLOUR)]
    shades = noise_map.colours(np.array(noise_map.MARKS)).tolist()
    marks = zip(noise_map.MARKS, shades, strict=True)
    return [("noise of each pixel: ", COLOUR)] + [
        each for mark, shade in marks for each in (("\u25a0 ", shade), (f"{100.0 * mark:g}%   ", COLOUR))
    ]


def _told_noise(statistics: Statistics) -> str:
    """How much, how much of it is to be seen, and what takes it away. A picture that is still being refined
    gets better by itself."""
    found = verdict(statistics.noise)
    words = f"noise {percent(statistics.noise)}, {found.value}"
    lower = "samples" if statistics.is_converged else statistics.out_of
    if lower and found is not Verdict.INVISIBLE:
        words += f": {advice((lower,))}"
    return words


def lines_above(space, region_3d, view, engine: str, is_playing: bool) -> float:
    """How many lines of Blender's own text stand in the corner of a 3D View (view3d_draw.cc,
    `view3d_draw_region_info`). `view`: the preferences of that name; `engine` the scene's."""
    overlay, found = space.overlay, 0.0
    if not overlay.show_overlays:
        return found
    if overlay.show_text:
        found += view.show_view_name or (view.show_playback_fps and is_playing)
        found += view.show_object_info
        shows_grid = overlay.show_floor or overlay.show_axis_x or overlay.show_axis_y or overlay.show_axis_z
        found += shows_grid and region_3d.is_orthographic_side_view  # the unit of its squares
        if space.shading.type in ("MATERIAL", "RENDERED"):
            drawn_by = engine if space.shading.type == "RENDERED" else "BLENDER_EEVEE"
            found += ENGINE.get(drawn_by, 1.0)
    found += STATISTICS * overlay.show_stats
    return found + GAP if found else 0.0


def free_corner(region, others) -> tuple[int, int]:
    """The top left of what is free of a region, in its pixels: headers and the toolbar lie over it."""
    left, top = 0, region.height
    for other in others:
        is_over = (
            other.width > 1
            and other.height > 1
            and other.x < region.x + region.width
            and other.x + other.width > region.x
            and other.y < region.y + region.height
            and other.y + other.height > region.y
        )
        if is_over and other.type in ("HEADER", "TOOL_HEADER") and other.alignment == "TOP":
            top = min(top, other.y - region.y)
        if is_over and other.type == "TOOLS" and other.alignment == "LEFT":
            left = max(left, other.x + other.width - region.x)
    return left, top


def draw(statistics: Statistics, context) -> None:
    """Into the region at hand, below what Blender writes there, and as large."""
    preferences, region = context.preferences, context.region
    scale, points = preferences.system.ui_scale, preferences.ui_styles[0].widget.points
    is_playing = any(window.screen.is_animation_playing for window in context.window_manager.windows)
    above = lines_above(
        context.space_data,
        context.region_data,
        preferences.view,
        context.scene.render.engine,
        is_playing,
    )
    left, top = free_corner(region, context.area.regions)
    x, y = left + 0.5 * WIDGET_UNIT * scale, top - 0.1 * WIDGET_UNIT * scale - above * LINE * points * scale
    blf.size(FONT, points * scale)
    blf.enable(FONT, blf.SHADOW)
    blf.shadow(FONT, 3, *SHADOW)
    rows = [[(text, COLOUR)] for text in lines(statistics)]
    if context.scene.strata.preview.shows_noise:
        rows.append(legend(statistics))
    for row in rows:
        y -= LINE * points * scale
        right = x
        for text, colour in row:
            blf.color(FONT, *colour)
            blf.position(FONT, right, y, 0.0)
            blf.draw(FONT, text)
            right += blf.dimensions(FONT, text)[0]
    blf.disable(FONT, blf.SHADOW)
