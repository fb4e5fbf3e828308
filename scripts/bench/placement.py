"""Section "Places of samples": patterns finer than a pixel, edges, errors in use, and time."""

from __future__ import annotations

import time

import numpy as np
import strata_kernels
from strata.addon.core.pixel_filter import filter_weight
from strata.addon.core.placement import Placement, Places
from strata.addon.core.sampling import footprints, jitters
from strata.addon.core.shot import PixelFilter
from strata.addon.core.view import View

from . import machine
from .document import significant, table
from .samples import SAMPLES, TRUTH, baked, in_use
from .scenes import open_sample, read

PLACEMENTS = (Placement.SHARED, Placement.PER_PIXEL)
BOX, USUAL = PixelFilter("BOX", 0.5), PixelFilter()
FREQUENCY, FALSE = 0.9, 0.1
"""Cycles a pixel: of the grating, and of what it must not become."""
SIDE = 500  # pixels: a whole number of periods of either
EDGES, EDGE_SIDE, FINE = 64, 32, 4096
METHODS = {"bitmask": {"method": "bitmask"}, "rays": {"method": "rays"}}


def section(quick: bool) -> str:
    """What is right, of either."""
    told = {Placement.SHARED: "shared", Placement.PER_PIXEL: "per pixel"}
    counts = (1, 4) if quick else (1, 4, 16, 64)
    gratings, edges, used = [], [], []
    for name, pixel_filter in (("box", BOX), ("Blackman-Harris", USUAL)):
        truth = _blurred_grating(pixel_filter)
        for count in counts[:3]:
            row = [name, count]
            for placement in PLACEMENTS:
                found = _coverage(_grating(), SIDE, placement, pixel_filter, count)
                row += [f"{_false_peak(found):.4f}", f"{np.sqrt(np.mean((found - truth) ** 2)):.3f}"]
            gratings.append([*row, f"{_false_peak(np.broadcast_to(truth, (SIDE, SIDE))):.4f}"])
        rows = {placement: _edge_errors(placement, pixel_filter, counts) for placement in PLACEMENTS}
        edges += [[name, told[each], *(f"{error:.3f}" for error in rows[each])] for each in PLACEMENTS]
    size, most, some = ((96, 54), 8, (1, 4)) if quick else ((240, 135), 128, (1, 4, 8, 16))
    for name in SAMPLES[-1:] if quick else SAMPLES:
        scene = open_sample(name)
        truth, _ = baked(scene, TRUTH, most, size, lit=True, seed=1)
        for method, values in METHODS.items():
            for placement in PLACEMENTS:
                row = [name, method, told[placement]]
                for samples in some:
                    found, _ = baked(scene, values, samples, size, placement=placement.value)
                    errors = list(in_use(found, truth).values())
                    row.append(f"{np.sqrt(np.mean(np.square(errors))):.4f}")
                used.append(row)
    return "\n\n".join(
        [
            f"Bars of {FREQUENCY} cycles a pixel, {SIDE}x{SIDE} orthographic pixels: how much there is of "
            f"{FALSE} cycles a pixel (amplitude), which one place for all makes of it, beside the filtered "
            "bars' own; and RMSE against those.",
            table(
                ["filter", "samples", "shared: false", "RMSE", "per pixel: false", "RMSE", "true"], gratings
            ),
            f"Coverage by half-planes: RMSE of the pixels that {EDGES} edges cross, in every direction, by "
            "samples a pixel.",
            table(["filter", "placement", *map(str, counts)], edges),
            f"Soft shadows, {size[0]}x{size[1]}: error in use, root mean square over the lamps, against "
            f"{most} samples of {TRUTH['sample_rays']} rays, by samples a pixel.",
            table(["scene", "method", "placement", *map(str, some)], used),
        ]
    )


def _offsets(placement: Placement, pixel_filter: PixelFilter, side: int, samples: int):
    """What the rasteriser takes for each of the samples."""
    if placement == Placement.SHARED:
        return [{"jitter": tuple(map(float, jitter))} for jitter in jitters(pixel_filter, samples)]
    return [{"offsets": _own(pixel_filter, (side, side), sample)} for sample in range(samples)]


def _own(pixel_filter: PixelFilter, size: tuple[int, int], sample: int) -> np.ndarray:
    places = Places(1, pixel_filter)
    return strata_kernels.pixel_offsets(places.seed, sample, places.table, (0, size[1]), (0, size[0]))


def _coverage(triangles, side: int, placement: Placement, pixel_filter: PixelFilter, samples: int):
    """(side, side) float64: the share of a pixel's samples that see any of the triangles (T, 3, 2), which
    are given in pixels."""
    geometry = strata_kernels.Geometry()
    corners = np.concatenate([triangles, np.full((*triangles.shape[:2], 1), -1.0)], axis=-1)
    positions = corners.reshape(-1, 3).astype(np.float32)
    starts = np.arange(0, len(positions) + 1, 3, dtype=np.int32)
    mesh = geometry.add_mesh(positions, np.arange(len(positions), dtype=np.int32), starts)
    geometry.add_instance(mesh, np.eye(4), 0, [geometry.add_material()])
    axes = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)
    view = View((0.0, 0.0, 0.0), *axes, (0.0, side, 0.0, side), 0.1, 10.0, True).packed()
    total = np.zeros((side, side))
    for more in _offsets(placement, pixel_filter, side, samples):
        seen = strata_kernels.raster_surface(
            geometry, np.ones(1, bool), view, side, side, attributes=["depth"], **more
        )
        total += np.isfinite(seen["depth"])
    return total / samples


def _grating() -> np.ndarray:
    """(T, 3, 2) bars half a period wide, beyond the image on all sides."""
    left = np.arange(-8.0, SIDE + 8.0, 1.0 / FREQUENCY)
    right = left + 0.5 / FREQUENCY
    low, high = np.full_like(left, -9.0), np.full_like(left, SIDE + 9.0)
    corners = [np.stack(each, -1) for each in ((left, low), (right, low), (right, high), (left, high))]
    return np.concatenate([np.stack([corners[i] for i in three], 1) for three in ((0, 1, 2), (0, 2, 3))])


def _blurred_grating(pixel_filter: PixelFilter) -> np.ndarray:
    """(SIDE,) what each column should be."""
    away = pixel_filter.radius * ((np.arange(FINE) + 0.5) / FINE * 2.0 - 1.0)
    weight = filter_weight(pixel_filter, away)
    phase = ((np.arange(SIDE)[:, None] + 0.5 + away + 8.0) * FREQUENCY) % 1.0
    return (phase < 0.5) @ weight / weight.sum()


def _false_peak(image: np.ndarray) -> float:
    return float(2.0 * np.abs(np.fft.rfft(image.mean(axis=0))[round(FALSE * SIDE)]) / SIDE)


def _edge_errors(placement: Placement, pixel_filter: PixelFilter, counts) -> list[float]:
    """RMSE by number of samples."""
    rng, fine = np.random.default_rng(1), footprints(pixel_filter, 1, FINE, 2)[0]
    squares = {count: [] for count in counts}
    centres = np.stack(np.meshgrid(*[np.arange(EDGE_SIDE) + 0.5] * 2), axis=-1)
    for angle in np.pi * (np.arange(EDGES) + rng.random(EDGES)) / EDGES * 2.0:
        normal = np.array([np.cos(angle), np.sin(angle)])
        along = np.array([-normal[1], normal[0]])
        at = EDGE_SIDE * (0.5 + 0.2 * rng.uniform(-1.0, 1.0, 2))
        inside = at[None] + 200.0 * np.array([along, -along, -normal])
        away = (centres - at) @ normal
        crossed = np.abs(away) < 2.0 * pixel_filter.radius + 1e-9
        truth = (away[crossed][:, None] + fine @ normal < 0.0).mean(axis=1)
        mixed = (truth > 0.01) & (truth < 0.99)
        for count in counts:
            found = _coverage(inside[None], EDGE_SIDE, placement, pixel_filter, count)
            squares[count].append((found[crossed] - truth)[mixed] ** 2)
    return [float(np.sqrt(np.concatenate(each).mean())) for each in squares.values()]


def times(quick: bool) -> str:
    """What either costs in the rasteriser."""
    rows, size, rounds = [], (960, 540), 1 if quick else 5
    for name in SAMPLES:
        case = read(open_sample(name), size)
        geometry, everything = case.device.geometry(), np.ones(len(case.outline.instances), np.uint8)
        view, names = case.graph.shot.view.packed(), ["position", "geometric_normal", "shading_normal"]
        seconds = {placement: [] for placement in PLACEMENTS}
        for _ in range(rounds):
            for placement in PLACEMENTS:
                started = time.process_time()
                more = {} if placement == Placement.SHARED else {"offsets": _own(USUAL, size, 0)}
                strata_kernels.raster_surface(geometry, everything, view, *size, attributes=names, **more)
                seconds[placement].append(time.process_time() - started)
        shared, own = (min(seconds[placement]) for placement in PLACEMENTS)
        rows.append([name, significant(1e3 * shared, 3), significant(1e3 * own, 3), f"{own / shared:.2f}"])
    return (
        f"The surface of one sample, {size[0]}x{size[1]}, positions and normals, places included: CPU "
        f"milliseconds of all cores, the lower of {rounds}. {machine.description()}.\n\n"
        + table(["scene", "shared", "per pixel", "ratio"], rows)
    )
