"""Says of any image how far it is from what a layer should be, by the same truth for all."""

from __future__ import annotations

import json
import math
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..bake import BakeJob
from ..core.random import hash_bits, text_bits
from ..layers.files import replaced
from ..measure.footprint import Probed
from ..measure.whole import Whole
from .picture import difference_png
from .setting import Setting

MOST_PIXELS = 1 << 18
"""That rays look at; of a larger image every so many-th."""
SEED = 0x7275
"""Of the truth's rays, which no bake has."""
NAME, IMAGES = "truth.npz", "images"


class Judge:
    """`truths`: by layer's name, of those that multiply; `layers`: what the scene has, as plain values. Both
    are kept in `kept`, so that a report that goes on has the same; pictures are in `folder`."""

    def __init__(self, folder: Path, kept: Path):
        self.folder, self._kept = folder, kept
        self.truths: dict[str, Whole] = {}
        self.layers: list[dict[str, Any]] = []
        self.size = (0, 0)
        self.is_new = not (kept / NAME).exists()
        if not self.is_new:
            self._read()

    def look_at(self, job: BakeJob) -> None:
        """Finds the truth of each layer while the job measures it."""

        def look(probed: Probed) -> Generator[None]:
            score = probed.layer.kind.score
            if hasattr(score, "whole"):
                height, width = probed.image.shape[:2]
                seed = int(hash_bits(SEED, text_bits(probed.layer.name)))
                pixels = _pixels(width, height)
                self.truths[probed.layer.name] = yield from score.whole(probed, pixels, seed, lambda _: None)

        job.look = look

    def keep(self, job: BakeJob) -> None:
        """After the job."""
        graph = job.graph
        self.layers = [
            {
                "name": layer.name,
                "effect": layer.effect,
                "light": layer.light,
                "metric": layer.kind.score.metric if layer.kind.score else "",
            }
            for layer in graph.layers
            if layer.effect
        ]
        told = {"layers": self.layers, "truths": list(self.truths)}
        told["size"] = list(graph.shot.computed_size)
        arrays = {
            f"{number}.{key}": each
            for number, whole in enumerate(self.truths.values())
            for key, each in whole.to_arrays().items()
        }
        with replaced(self._kept / NAME) as stream:
            np.savez(stream, told=np.array(json.dumps(told)), **arrays)
        self.size = tuple(told["size"])

    def _read(self) -> None:
        with np.load(self._kept / NAME) as found:
            told = json.loads(str(found["told"]))
            for number, name in enumerate(told["truths"]):
                prefix = f"{number}."
                parts = {key[len(prefix) :]: found[key] for key in found if key.startswith(prefix)}
                self.truths[name] = Whole.from_arrays(parts)
        self.layers, self.size = told["layers"], tuple(told["size"])

    def judged(self, setting: Setting, name: str, images: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """Of the best of some ways to read a layer (height, width[, channels]); nothing without a truth.
        Leaves a picture of how far it is off."""
        if name not in self.truths:
            return {}
        whole = self.truths[name]
        found = {way: whole.judged(image) for way, image in images.items()}
        way = min(found, key=lambda way: found[way].value)
        path = self.folder / IMAGES / f"{_number(setting, name):08x}.png"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(difference_png(whole, images[way], self.size))
        ways = {each: judged.value for each, judged in found.items()} if len(found) > 1 else {}
        return {**found[way].to_json(), "way": way, "ways": ways, "image": path.name}


def _number(setting: Setting, name: str) -> int:
    return int(hash_bits(text_bits(setting.key), text_bits(name)))


def _pixels(width: int, height: int) -> np.ndarray:
    """(P,) all, or every so many-th each way."""
    step = math.ceil(math.sqrt(width * height / MOST_PIXELS))
    numbers = np.arange(width * height).reshape(height, width)
    return np.ascontiguousarray(numbers[step // 2 :: step, step // 2 :: step].reshape(-1))
