"""EEVEE in another Blender: each lamp rendered by itself, since it has no light groups."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...audit.other_blender import run_program
from ...core.errors import DeviceUnavailable, StrataError
from ...devices import gpu_context
from ...layers.exr_pixels import read_pixels
from ..cost import Cost
from ..setting import Setting
from .cycles import AUDIT
from .cycles import PROGRAM as LAMP_LIGHT
from .rival import BY_LIGHT, Case, Found, factor

PROGRAM = LAMP_LIGHT.with_name("eevee_light.py")
SAMPLES = (4, 16, 64)
CURVE = "a render of each lamp"


class Eevee:
    """With its soft shadows' jitter on. A lamp's shadow is its light over that of a render of as many samples
    without shadows, whose time does not count; that of a first render, which makes the shaders, neither."""

    id = "eevee"
    title = "EEVEE"
    told = BY_LIGHT

    def why_not(self) -> str:
        try:
            gpu_context.started()
        except DeviceUnavailable as error:
            return str(error)
        return ""

    def settings(self, case: Case) -> list[Setting]:
        """Raises StrataError for a pixel filter that it has not."""
        if case.request["filter"]["kind"] != "BLACKMAN_HARRIS":
            raise StrataError("its pixel filter is Blackman-Harris")
        return [Setting(self.id, CURVE, each, each) for each in SAMPLES]

    def run(self, case: Case, setting: Setting, wants_images: bool, look: Callable[[], None]) -> Found:
        shadows = ("first", True, False) if wants_images else ("first", True)
        renders = [
            {"shadow": bool(each), "samples": 1 if each == "first" else setting.samples} for each in shadows
        ]
        folder = Path(case.scene.folder.name)
        numbers = [str(number) for number in range(len(renders))]
        made = {
            (number, lamp): folder / f"{number}_{group}.exr"
            for number in numbers
            for lamp, group in case.groups.items()
        }
        files = [*made.values(), folder / "costs.json"]
        for path in files:
            path.unlink(missing_ok=True)
        request = {**case.request, "audit": str(AUDIT), "lamp_light": str(LAMP_LIGHT), "groups": case.groups}
        request |= {"renders": renders, "samples": 1}
        run_program(case.scene, PROGRAM, request, files, look=look)
        cost = Cost(**json.loads(files[-1].read_text(encoding="utf-8"))[1])
        if not wants_images:
            return Found(cost)
        images = {}
        for layer, lamp in case.lamps.items():
            shadowed, bare = (_combined(made[each, lamp], request["view_layer"]) for each in numbers[1:])
            share = factor(shadowed, bare, case.luminance, layer in case.in_colour)
            images[layer] = {"over its own": share}
        return Found(cost, images)


def _combined(path: Path, view_layer: str) -> np.ndarray:
    """(height, width, 3)."""
    planes = read_pixels(path)
    return np.stack([planes[f"{view_layer}.Combined.{each}"] for each in "RGB"], axis=-1)


EEVEE = Eevee()
