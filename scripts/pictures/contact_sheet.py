"""A picture of a bake for a person: the shadows on a simple lit image, then every layer with its figures.

Only for developers' demos (needs Pillow, which Blender does not carry); the extension does not ship it.
"""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont
from strata.addon.core.layers import Layer, LayerSet
from strata.addon.effects.registry import EFFECTS
from strata.addon.measure.report import NotMeasured, error_of
from strata.addon.measure.verdict import causes, interval_words, off_by, percent

WIDTH, MARGIN, GAP, LINE = 1600, 48, 28, 22
BACKGROUND, PANEL, TEXT, QUIET, ACCENT = "#15171c", "#1d2027", "#eceef2", "#9aa3b2", "#f2b261"
REC709_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
AMBIENT = 0.07  # share of the unshadowed light that still reaches a shadow: stands in for bounces


@cache
def label_font(size: int, weight: str = "Regular") -> ImageFont.FreeTypeFont:
    """Blender's own interface font: it knows every script that a light's name may be written in."""
    folder = Path(find_spec("bpy").origin).parent
    font = ImageFont.truetype(next(folder.glob("*/datafiles/fonts/Inter.woff2")), size)
    font.set_variation_by_name(weight)
    return font


def composite(layers: tuple[Layer, ...], lit: dict[int, np.ndarray]) -> np.ndarray:
    """Linear (height, width, 3): each light's unshadowed diffuse radiance, by light index, times its shadow
    layer."""
    shadows = {layer.of.index: layer.pixels for layer in layers if layer.channels == "V"}
    total = np.zeros((*next(iter(lit.values())).shape[:2], 3), np.float32)
    for index, radiance in lit.items():
        visible = shadows[index][:, :, None] if index in shadows else 1.0
        total += radiance[..., :3] * (visible * (1.0 - AMBIENT) + AMBIENT)
    return total


def developed(linear: np.ndarray) -> np.ndarray:
    """Scene-linear to 8-bit sRGB: exposed for the bright surfaces, highlights rolled off (Reinhard et al.
    2002, eq. 4, on luminance so that hues stay). Pixels without light take the sheet's panel colour."""
    linear = np.nan_to_num(linear.astype(np.float64))
    luminance = linear @ REC709_LUMINANCE
    surfaces = luminance[luminance > 0]
    panel = np.array(ImageColor.getrgb(PANEL), np.uint8)
    if not len(surfaces):
        return np.broadcast_to(panel, linear.shape)
    exposed = luminance * (1.1 / np.percentile(surfaces, 90))
    white = float(exposed.max())
    rolled = exposed * (1.0 + exposed / white**2) / (1.0 + exposed)
    scale = np.divide(rolled, luminance, out=np.zeros_like(luminance), where=luminance > 0)
    return np.where(luminance[:, :, None] > 0, srgb(linear * scale[:, :, None]), panel)


def srgb(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1's transfer function, to uint8."""
    linear = np.clip(np.nan_to_num(linear), 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(encoded * 255.0).astype(np.uint8)


def as_picture(layer: Layer) -> Image.Image:
    """A layer as a person should see it; top row first."""
    if layer.pixels.ndim == 2:
        values = np.repeat(layer.pixels[:, :, None], 3, axis=2)
    else:
        values = layer.pixels[:, :, :3]
    return Image.fromarray(np.ascontiguousarray((developed if layer.is_colour else srgb)(values)[::-1]))


def save_contact_sheet(path: str | Path, layer_set: LayerSet, lit: dict[int, np.ndarray]) -> None:
    """Writes the sheet as PNG. `lit`: unshadowed diffuse radiance by light, (height, width, 4) linear."""
    hero = Image.fromarray(np.ascontiguousarray(developed(composite(layer_set.layers, lit))[::-1]))
    aspect = layer_set.height / layer_set.width
    hero_size = (WIDTH - 2 * MARGIN, round((WIDTH - 2 * MARGIN) * aspect))
    columns = 2 if len(layer_set.layers) in (1, 2, 4) else 3
    tile_width = (WIDTH - 2 * MARGIN - (columns - 1) * GAP) // columns
    tile_size = (tile_width, round(tile_width * aspect))
    rows = -(-len(layer_set.layers) // columns)
    notes = _notes(layer_set.report)
    told = {entry["name"]: entry for entry in layer_set.report.get("layers", ())}
    captions = [_caption(layer, told.get(layer.name, {})) for layer in layer_set.layers]
    caption = 52 + LINE * max(map(len, captions), default=0)
    grid_top = 132 + hero_size[1] + GAP
    notes_top = grid_top + rows * (tile_size[1] + caption + GAP)
    sheet = Image.new("RGB", (WIDTH, notes_top + 30 * len(notes) + MARGIN), BACKGROUND)
    draw = ImageDraw.Draw(sheet)

    draw.text((MARGIN, 34), "Strata", TEXT, label_font(44, "SemiBold"))
    draw.text((MARGIN, 92), _subtitle(layer_set), QUIET, label_font(20))
    sheet.paste(hero.resize(hero_size, Image.Resampling.LANCZOS), (MARGIN, 132))
    for index, layer in enumerate(layer_set.layers):
        x = MARGIN + (index % columns) * (tile_width + GAP)
        y = grid_top + (index // columns) * (tile_size[1] + caption + GAP)
        _draw_tile(sheet, draw, layer, (x, y), tile_size, caption, captions[index])
    for index, note in enumerate(notes):
        draw.text((MARGIN, notes_top + 30 * index), note, QUIET, label_font(17))
    sheet.save(path)


def _caption(layer: Layer, told: dict) -> tuple[str, ...]:
    """`told`: what the report has of it."""
    settings = told.get("lowered_by", ())
    params = EFFECTS.named(layer.effect).params if settings else None
    return error_lines(layer.error, layer.light, told.get("verdict", ""), settings, params)


def _draw_tile(sheet, draw, layer: Layer, corner, size, caption: int, lines: tuple[str, ...]) -> None:
    (x, y), (width, height) = corner, size
    draw.rectangle((x, y, x + width - 1, y + height + caption - 1), PANEL)
    sheet.paste(as_picture(layer).resize(size, Image.Resampling.LANCZOS), corner)
    title = label_font(22, "Medium")
    draw.text((x + 16, y + height + 12), _fitted(draw, layer.name, title, width - 130), TEXT, title)
    seconds = f"{layer.seconds:.2f} s"
    draw.text((x + width - 16, y + height + 13), seconds, ACCENT, label_font(20), anchor="ra")
    for line, text in enumerate(lines):
        font = label_font(16)
        text = _fitted(draw, text, font, width - 32)
        draw.text((x + 16, y + height + 44 + LINE * line), text, ACCENT if not line else QUIET, font)


def error_lines(error: dict, light: str = "", verdict: str = "", settings=(), params=None) -> tuple[str, ...]:
    """The caption's lines: what the error is; how much of it is to be seen, with its interval; where it comes
    from and what lowers it, a line for each clause, or how it was measured."""
    found = error_of(error)
    if found is None:
        return ("error not measured",)
    if isinstance(found, NotMeasured):
        return "error not measured", found.why
    seen = f"{verdict} (95% sure: {interval_words(*found.ci95)})".lstrip()
    measured = f"{found.probes} probes · {found.reference}"
    why = causes(found, settings, params)
    return off_by(found.metric, percent(found.value), light), seen, *(why or [measured])


def _fitted(draw, text: str, font, width: int) -> str:
    """The text, cut with an ellipsis where it is wider than `width` pixels."""
    if draw.textlength(text, font) <= width:
        return text
    while text and draw.textlength(text + "…", font) > width:
        text = text[:-1]
    return text + "…"


def _subtitle(layer_set: LayerSet) -> str:
    report = layer_set.report
    facts = [
        report.get("scene"),
        f"{layer_set.width} x {layer_set.height}",
        f"{len(layer_set.layers)} layers",
        f"{report['backend'].upper()}" if report.get("backend") else None,
        f"{report['seconds']:.1f} s" if "seconds" in report else None,
    ]
    return "   ·   ".join(fact for fact in facts if fact)


def _notes(report: dict, most: int = 6) -> list[str]:
    """What was left out and why, and the warnings."""
    notes = [f"Left out: {entry['what']} - {entry['reason']}" for entry in report.get("left_out", ())]
    notes += [f"Warning: {warning}" for warning in report.get("warnings", ())]
    return [*notes[:most], f"... and {len(notes) - most} more"] if len(notes) > most else notes
