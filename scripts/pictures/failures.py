"""Where the methods of soft shadows fail, beside the truth by rays: docs/images/failure_*.png.

Each picture is the layer V itself, 1 is white, at pixel centres; the figure is the frame's weighted RMSE.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw
from strata.scripts.bench.document import ROOT
from strata.scripts.bench.methods import Effect, Rays, surface_of
from strata.scripts.bench.scenes import open_sample, read
from strata.scripts.pictures.contact_sheet import label_font, srgb
from strata.tests.support.figures import weighted_rmse

SIZE = (640, 360)
RAYS = 1024
GAP, LABEL = 6, 44
IMAGES = ROOT / "docs" / "images"


@dataclass(frozen=True)
class Failure:
    """`crop`: left, top, right, bottom in pixels; `methods`: a label and the settings of each."""

    scene: str
    crop: tuple[int, int, int, int]
    methods: dict[str, dict]


def _settings(method: str, layers: int) -> dict:
    return {"method": method, "layers": layers}


FAILURES = {
    # Casters above casters: areas that overlap are added, bits are joined.
    "overlap": Failure(
        "stacked",
        (90, 130, 390, 330),
        {
            "area, 1 layer": _settings("area", 1),
            "area, 3 layers": _settings("area", 3),
            "bitmask, 3 layers": _settings("bitmask", 3),
        },
    ),
    # Filaments far thinner than a texel of the map.
    "thin": Failure(
        "dandelion",
        (300, 200, 560, 350),
        {
            "bitmask, 3 layers": _settings("bitmask", 3),
            "hybrid, 3 layers": _settings("hybrid", 3),
        },
    ),
}


def picture(failure: Failure) -> Image.Image:
    """The truth, then each method, in a row."""
    case = read(open_sample(failure.scene), SIZE)
    surface, seen = surface_of(case)
    rays = Rays(case, surface, RAYS)
    rays()
    panels = [(f"rays, {RAYS} a point", "truth", rays.visibility.reshape(seen.shape))]
    for label, values in failure.methods.items():
        effect = Effect(case, values)
        effect()
        errors = effect.visibility.reshape(-1) - rays.visibility
        figure = f"RMSE {weighted_rmse(errors.astype(np.float64), rays.weight.astype(np.float64)):.4f}"
        panels.append((label, figure, effect.visibility))
    left, top, right, bottom = failure.crop
    width, height = right - left, bottom - top
    sheet = Image.new("L", (len(panels) * (width + GAP) - GAP, height + LABEL), 24)
    draw = ImageDraw.Draw(sheet)
    for number, (label, figure, visibility) in enumerate(panels):
        x = number * (width + GAP)
        shown = Image.fromarray(srgb(np.where(seen, visibility, 0.0)[::-1]))
        sheet.paste(shown.crop(failure.crop), (x, LABEL))
        draw.text((x + 6, 4), label, 236, label_font(15))
        draw.text((x + 6, 23), figure, 190, label_font(15))
    return sheet


def main() -> None:
    for name, failure in FAILURES.items():
        path = IMAGES / f"failure_{name}.png"
        picture(failure).save(path, optimize=True)
        print(f"wrote {path.relative_to(ROOT)}, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
