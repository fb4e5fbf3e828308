"""The courtyard with mist and ink: docs/images/courtyard.png, the README's first picture.

Every lamp's light times its soft shadow, through the mist and with the light that the mist scatters, under
the toon outline: the layers of one bake, joined as they are meant to be.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from PIL import Image
from strata.addon.bake import BakeJob, read_scene
from strata.addon.planning import Options
from strata.scripts.bench.document import ROOT
from strata.scripts.bench.scenes import open_sample
from strata.scripts.pictures.contact_sheet import developed

AMBIENT = 0.05  # share of each lamp's unshadowed light that stands in for bounces
SETTINGS = {
    "volumetric_light": {
        "use_scene_medium": False,
        "scattering_per_m": (0.06, 0.058, 0.055),
        "anisotropy": 0.3,
    },
    "toon": {
        "shadows": False,
        "halftone": False,
        # Thinner with distance, as a pen would draw it.
        "outline_unit": "metre",
        "outline_width_m": 0.012,
        "outline_least_px": 0.8,
        "outline_most_px": 2.4,
        "outline_color": (0.02, 0.012, 0.01),
        "crease_angle": math.radians(60.0),
    },
}


def picture(size: tuple[int, int], samples: int, method: str) -> np.ndarray:
    """(height, width, 3) uint8, top row first."""
    scene = open_sample("courtyard")
    values = {**SETTINGS, "soft_shadow": {"method": method, "rays": 32}}
    options = Options(("soft_shadow", "volumetric_light", "toon"), "cpu", samples, 0, values, lit=True)
    *read, _ = read_scene(scene, scene.view_layers[0], options, size=size)
    baked = BakeJob(*read, options).result()
    layers = baked.layers.layers
    shadows = {layer.of.index: layer.pixels[..., None] for layer in layers if layer.effect == "soft_shadow"}
    picture = sum(
        lit[..., :3] * (shadows.get(index, 1.0) * (1.0 - AMBIENT) + AMBIENT)
        for index, lit in baked.lit.items()
    )
    mist = {layer.name: layer.pixels for layer in layers if layer.effect == "volumetric_light"}
    picture = picture * mist.pop("Transmittance") + sum(mist.values())
    (ink,) = (layer.pixels for layer in layers if layer.name == "Toon Outline")
    toned = developed(picture)[::-1] / 255.0
    ink = ink[::-1]
    inked = ink[..., :3] ** (1 / 2.2) + (1.0 - ink[..., 3:]) * toned
    return np.round(255.0 * inked.clip(0.0, 1.0)).astype(np.uint8)


def main() -> None:
    """Writes it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--samples", type=int, default=8)
    parser.add_argument("--method", default="hybrid")
    parser.add_argument("--output", default=ROOT / "docs" / "images" / "courtyard.png")
    arguments = parser.parse_args()
    size = tuple(map(int, arguments.size.split("x")))
    image = Image.fromarray(picture(size, arguments.samples, arguments.method))
    image.save(arguments.output, optimize=True)


if __name__ == "__main__":
    main()
