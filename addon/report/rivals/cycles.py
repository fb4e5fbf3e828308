"""Cycles in another Blender: all lamps in one render, each in a light group, light tree on, with and without
a Denoise node on each group."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

from ...audit.other_blender import run_program
from ...layers.exr_pixels import read_pixels
from ...layers.files import replaced
from ..cost import Cost
from ..setting import Setting
from .rival import BY_LIGHT, Case, Found, factor

PROGRAM = Path(__file__).parents[1] / "programs" / "lamp_light.py"
"""In a folder of its own: Python looks there first, and would take cycles.py for Blender's."""
AUDIT = Path(__file__).parents[2] / "audit" / "program.py"
SAMPLES = (4, 16, 64, 256)
DENOISED_SAMPLES = (4, 16, 64)
BARE_SAMPLES = 256
"""Without shadows there is less noise."""
PLAIN, DENOISED = "one render, light groups", "one render, light groups, denoised"


class Cycles:
    """Its light of a lamp is read in two ways: over that of a render of the same samples without shadows, of
    which much of the noise is the same, and over what the lamp gives without shadows, converged. The time of
    neither of those two counts, and the better of both ways does."""

    id = "cycles"
    title = "Cycles"
    told = BY_LIGHT

    def why_not(self) -> str:
        return "" if bpy.app.build_options.cycles else "this Blender was built without Cycles"

    def settings(self, case: Case) -> list[Setting]:
        return [
            Setting(self.id, curve, each, each)
            for curve, samples in ((PLAIN, SAMPLES), (DENOISED, DENOISED_SAMPLES))
            for each in samples
        ]

    def run(self, case: Case, setting: Setting, wants_images: bool, look: Callable[[], None]) -> Found:
        denoise = setting.curve == DENOISED
        renders = [{"shadow": True, "samples": setting.samples, "denoise": denoise}]
        if not wants_images:
            return Found(_rendered(case, renders, look)[1][0])
        renders.append({"shadow": False, "samples": setting.samples, "denoise": denoise})
        (shadowed, bare), costs = _rendered(case, renders, look)
        converged, images = self._bare(case, look), {}
        for layer in case.lamps:
            ways = {"over its own": bare[layer], "over the converged": converged[layer]}
            images[layer] = {
                way: factor(shadowed[layer], light, case.luminance, layer in case.in_colour)
                for way, light in ways.items()
            }
        return Found(costs[0], images)

    def _bare(self, case: Case, look: Callable[[], None]) -> dict[str, np.ndarray]:
        """Without shadows, kept."""
        path = case.folder / "cycles_bare.npz"
        names = list(case.lamps)
        if path.exists():
            with np.load(path) as found:
                return dict(zip(names, found["images"], strict=True))
        renders = [{"shadow": False, "samples": BARE_SAMPLES, "denoise": False}]
        (images,), _ = _rendered(case, renders, look)
        with replaced(path) as stream:
            np.savez(stream, images=np.stack([images[name] for name in names]).astype(np.float32))
        return images


def _rendered(
    case: Case, renders: list, look: Callable[[], None]
) -> tuple[list[dict[str, np.ndarray]], list[Cost]]:
    """Of each render the light (height, width, 3) of each layer's lamp, and what it took."""
    folder = Path(case.scene.folder.name)
    paths = [folder / f"{number}.exr" for number in range(len(renders))]
    for path in paths:
        path.unlink(missing_ok=True)
    costs = folder / "costs.json"
    request = {**case.request, "audit": str(AUDIT), "groups": case.groups, "renders": renders, "samples": 1}
    run_program(case.scene, PROGRAM, request, [*paths, costs], look=look)
    found = []
    for path, render in zip(paths, renders, strict=True):
        planes = read_pixels(path)
        view_layer = f"{request['view_layer']}.Combined_"
        before = "" if render["denoise"] else view_layer
        found.append(
            {
                layer: np.stack([planes[f"{before}{case.groups[lamp]}.{each}"] for each in "RGB"], axis=-1)
                for layer, lamp in case.lamps.items()
            }
        )
    return found, [Cost(**each) for each in json.loads(costs.read_text(encoding="utf-8"))]


CYCLES = Cycles()
