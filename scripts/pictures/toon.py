"""The comic, and where its lines and dots fail: docs/images/toon.png and failure_toon_*.png."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw
from strata.addon.bake import bake
from strata.addon.planning import Options
from strata.scripts.bench.document import ROOT
from strata.scripts.bench.scenes import open_sample
from strata.scripts.pictures.contact_sheet import label_font, srgb

IMAGES = ROOT / "docs" / "images"
GAP, LABEL = 6, 40
PAPER = np.array([0.8, 0.85, 0.9])


def comic(size: tuple[int, int], **values) -> Image.Image:
    """All layers over paper: toon, dots, then ink."""
    scene = open_sample("comic")
    options = Options(("toon",), "cpu", 8, 0, {"toon": values})
    layers = bake(scene, scene.view_layers[0], options, size=size).layers.layers
    picture = np.broadcast_to(PAPER, (size[1], size[0], 3))
    for layer in layers:
        if layer.channels == "V":
            picture = picture * layer.pixels[..., None]
        else:
            picture = layer.pixels[..., :3] + (1.0 - layer.pixels[..., 3:]) * picture
    return Image.fromarray(np.ascontiguousarray(srgb(picture)[::-1]))


def side_by_side(crop: tuple[int, int, int, int], choices: dict[str, dict]) -> Image.Image:
    """The same part of the comic with different settings, labelled."""
    width, height = crop[2] - crop[0], crop[3] - crop[1]
    sheet = Image.new("RGB", (len(choices) * (width + GAP) - GAP, height + LABEL), "#15171c")
    draw = ImageDraw.Draw(sheet)
    for index, (label, values) in enumerate(choices.items()):
        x = index * (width + GAP)
        sheet.paste(comic((1280, 720), **values).crop(crop), (x, LABEL))
        draw.text((x + 8, 9), label, "#eceef2", label_font(18))
    return sheet


def main() -> None:
    """Writes all three."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    comic((1280, 720)).save(IMAGES / "toon.png", optimize=True)
    inner = {"object_lines": True, "crease_angle": 0.8}
    side_by_side((0, 40, 400, 400), {"hull alone": {}, "object lines, creases": inner}).save(
        IMAGES / "failure_toon_lines.png", optimize=True
    )
    surface = {"halftone_anchor": "surface", "halftone_cell_m": 0.06}
    side_by_side((420, 40, 780, 400), {"dots on the screen": {}, "dots on the surface": surface}).save(
        IMAGES / "failure_toon_dots.png", optimize=True
    )


if __name__ == "__main__":
    main()
