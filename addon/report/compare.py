"""The layers of two files beside each other."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import StrataError
from ..core.metrics import mean_brightness
from ..core.roles import Role
from ..layers.exr_header import header_of
from ..layers.exr_pixels import read_pixels
from .flip import flip

ORDER = "RGBXYZUVA"
MULTIPLIES = {Role.VISIBILITY.value, Role.TRANSMITTANCE.value, Role.FILTER.value}


@dataclass(frozen=True)
class Difference:
    """Of a layer: root mean square over pixels and channels; of what multiplies as it is, of anything else as
    a share of the second file's brightness there and on the mean (`is_share`). `p99`, `most`: of that, by
    pixels. `flip`: the mean, on a display. `non_finite`: numbers in either file, which count as 0. `errors`
    (height, width): signed."""

    name: str
    rms: float
    p99: float
    most: float
    flip: float
    is_share: bool
    non_finite: int
    errors: np.ndarray

    def to_json(self) -> dict[str, Any]:
        return {key: item for key, item in vars(self).items() if key != "errors"}


def compared(first: Path, second: Path, names: Sequence[str] = ()) -> list[Difference]:
    """`names`: of passes; without, all that the second has. Raises StrataError where the files do not go
    together."""
    both = [layers_of(path) for path in (first, second)]
    sizes = [next(iter(layers.values())).shape[1::-1] for layers in both]
    if sizes[0] != sizes[1]:
        raise StrataError("{} is {}x{}, {} is {}x{}".format(first, *sizes[0], second, *sizes[1]))
    wanted = [each for each in both[1] if not names or _pass(each) in names or each in names]
    unknown = [name for name in names if not any(name in (_pass(each), each) for each in both[1])]
    missing = [each for each in wanted if each not in both[0]]
    for path, lacking in ((second, unknown), (first, missing)):
        if lacking:
            raise StrataError(f"{path} has no layer {', '.join(repr(_pass(each)) for each in lacking)}")
    roles = _roles(second) | _roles(first)
    return [_difference(name, both[0][name], both[1][name], roles) for name in wanted]


def layers_of(path: Path) -> dict[str, np.ndarray]:
    """(height, width, channels) float64 by `<view layer>.<pass>`, row 0 at the bottom. Raises StrataError."""
    found: dict[str, dict[str, np.ndarray]] = {}
    for name, plane in read_pixels(path).items():
        layer, _, channel = name.rpartition(".")
        found.setdefault(layer, {})[channel] = plane
    if not found:
        raise StrataError(f"{path} has no layers")
    shapes = {plane.shape for planes in found.values() for plane in planes.values()}
    if len(shapes) > 1:
        raise StrataError(f"{path} has layers of several sizes")
    return {layer: _stacked(planes) for layer, planes in found.items()}


def _stacked(planes: dict[str, np.ndarray]) -> np.ndarray:
    order = sorted(planes, key=lambda each: (ORDER.find(each) if each in ORDER else len(ORDER), each))
    return np.stack([planes[channel] for channel in order], axis=-1).astype(np.float64)


def _pass(layer: str) -> str:
    return layer.rpartition(".")[2]


def _roles(path: Path) -> dict[str, str]:
    """By pass, where a report says."""
    rows = header_of(path).json("strata:report").get("layers", [])
    return {each["name"]: each.get("role", "") for each in rows if isinstance(each, dict) and "name" in each}


def _difference(name: str, first: np.ndarray, second: np.ndarray, roles: dict[str, str]) -> Difference:
    if first.shape != second.shape:
        raise StrataError(f"layer '{_pass(name)}' has {first.shape[2]} channels, and {second.shape[2]}")
    non_finite = int(np.count_nonzero(~np.isfinite(first)) + np.count_nonzero(~np.isfinite(second)))
    first, second = (np.where(np.isfinite(each), each, 0.0) for each in (first, second))
    is_share = roles.get(_pass(name)) not in MULTIPLIES
    errors, sizes = first - second, np.abs(second)
    if is_share:
        below = sizes + np.array([mean_brightness(plane) for plane in np.moveaxis(sizes, -1, 0)])
        errors = np.divide(errors, below, out=np.where(errors == 0.0, 0.0, 1.0), where=below > 0.0)
    of_pixels = np.sqrt((errors**2).mean(axis=-1))
    signs = np.sign(errors.sum(axis=-1))
    pictures = [_shown(each) for each in (first, second)]
    return Difference(
        name,
        float(np.sqrt((errors**2).mean())),
        float(np.quantile(of_pixels, 0.99)),
        float(of_pixels.max()),
        float(flip(*pictures).mean()),
        is_share,
        non_finite,
        signs * of_pixels,
    )


def _shown(layer: np.ndarray) -> np.ndarray:
    """The first three channels, or the only one as grey."""
    return layer[..., :3] if layer.shape[2] >= 3 else np.repeat(layer[..., :1], 3, axis=-1)


def file_name(layer: str) -> str:
    return re.sub(r"[^\w.-]+", "_", layer) + ".png"
