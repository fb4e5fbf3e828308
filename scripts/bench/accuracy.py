"""Measures how right Strata is and rewrites the figures in docs/accuracy.md, a block for each section.

python -m strata.scripts.bench.accuracy          everything (half an hour on two cores: most of it is Cycles)
python -m strata.scripts.bench.accuracy plates   these sections only
python -m strata.scripts.bench.accuracy --quick  tiny settings, printed, not written: whether it still runs
"""

from __future__ import annotations

from strata.scripts.bench import (
    against_cycles,
    airlight,
    close_casters,
    in_use,
    intervals,
    placement,
    plates,
    reading,
    targets,
    toon_errors,
    units,
)
from strata.scripts.bench.document import ROOT, rmse, table, write_block
from strata.scripts.bench.scenes import open_sample
from strata.scripts.bench.sections import read_sections

DOCUMENT = ROOT / "docs" / "accuracy.md"
METHODS = ("bitmask", "hybrid", "area")
HYBRID = {"soft_shadow": {"method": "hybrid", "rays": 32}}


def courtyard(quick: bool) -> str:
    """Every light of the courtyard against Cycles: with default settings, and by hybrid."""
    samples, size = (16, (160, 90)) if quick else (64, (480, 270))
    rows = []
    settings = {
        "bitmask": {"soft_shadow": {"method": "bitmask"}},
        "default (rays)": {},
        "hybrid, 32 rays": HYBRID,
    }
    for name, found in against_cycles.compare_all(open_sample("courtyard"), samples, size, settings):
        figures = [
            rmse(found.rmse),
            rmse(found.cycles_noise),
            rmse(found.rays_rmse),
            f"{found.bias:+.4f}",
            f"{found.p99:.3f}",
        ]
        rows.append([name, found.light, *figures, f"{found.largest:.2f}"])
    header = ["settings", "light", "RMSE", "Cycles' noise", "rays", "bias", "p99", "max"]
    return "\n\n".join(
        [
            "### Courtyard against Cycles",
            f"{size[0]}x{size[1]}, at pixel centres. Cycles: 2 x {samples} samples, each light alone, lit "
            "over unlit, its noise taken off. RMSE and bias are weighted by the unshadowed light. "
            "Rays: RMSE of Strata's own rays from every pixel against Cycles, most of it from one "
            "pixel in a thousand where the two are worlds apart.",
            table(header, rows),
        ]
    )


def closed_forms(quick: bool) -> str:
    """Plates over a ground."""
    size = (160, 90) if quick else plates.SIZE
    rows = []
    for method in METHODS:
        for found in plates.measure(method, size):
            figures = [rmse(found.rmse), f"{found.bias:+.4f}", f"{found.p99:.3f}", f"{found.largest:.3f}"]
            rows.append([method, found.light, found.plates, *figures])
    return "\n\n".join(
        [
            "### Plates against closed forms",
            f"The ground under one plate and under two that overlap, default settings but the method, "
            f"{size[0]}x{size[1]}.",
            table(["method", "light", "plates", "RMSE", "bias", "p99", "max"], rows),
        ]
    )


def used(quick: bool) -> str:
    """Layers multiplied onto Cycles' images."""
    return f"{in_use.lamps_alone(quick)}\n\n{in_use.pictures(quick)}"


def radiance(quick: bool) -> str:
    """Brightness of lamps."""
    rows = [
        [found.lamp, f"{found.ratio:.4f}", f"{found.deviation:.4f}"]
        for found in units.measure(16 if quick else 1024)
    ]
    return "\n\n".join(
        [
            "### Radiance units",
            "Cycles' unshadowed diffuse radiance of a white ground over Strata's: ratio of the images' sums, "
            "and RMS deviation of their pixels from that ratio.",
            table(["lamp", "Cycles over Strata", "deviation"], rows),
        ]
    )


def toon_shading(quick: bool) -> str:
    """Masks at their edges, and lines around a turntable."""
    return f"### Toon\n\n{toon_errors.masks(open_sample('comic'), quick)}\n\n{toon_errors.evenness(quick)}"


def volumetric(quick: bool) -> str:
    """Every light of mist, scattered once by its haze: by rays, and against Cycles."""
    scene = open_sample("mist")
    samples, size, large = (16, (96, 54), (96, 54)) if quick else (1024, (96, 54), (240, 135))
    probes = 64 if quick else airlight.PROBES
    measured = []
    for layer in airlight.by_rays(scene, large, airlight.SAMPLES, probes):
        error = layer.error
        interval = f"{rmse(error['ci95'][0])} to {rmse(error['ci95'][1])}"
        parts = rmse(error["method"]), rmse(error["sampling"]), rmse(error["reference_noise"])
        measured.append([layer.light, rmse(error["value"]), interval, *parts, f"{error['bias']:+.4f}"])
    rows = []
    for found in airlight.compare_all(scene, samples, size, probes=probes):
        figures = rmse(found.error), rmse(found.cycles_noise), f"{found.bias:+.4f}", rmse(found.method)
        rows.append([found.light, *figures])
    by_rays = ["light", "error in use", "95% interval", "method", "sampling", "rays' noise", "bias"]
    header = ["light", "error", "Cycles' noise", "bias", "method, by rays"]
    return "\n\n".join(
        [
            "### Mist by rays",
            f"Default settings, {large[0]}x{large[1]}, {airlight.SAMPLES} samples a pixel, {probes} probes, "
            "by 2 x 512 samples along each view ray, each with a ray to a random point of the light.",
            table(by_rays, measured),
            "### Mist against Cycles",
            f"One sample at pixel centres, {size[0]}x{size[1]}. Cycles: 2 x {samples} samples, each light "
            "alone, no bounces, its noise taken off; as shares of a pixel's brightness and the mean's. "
            "Beside it what the bake says of its method, by rays in some pixels.",
            table(header, rows),
        ]
    )


def close(quick: bool) -> str:
    """What stands close to spots and points."""
    size, radii = ((60, 45), (0.1,)) if quick else (close_casters.SIZE, close_casters.RADII_M)
    rows = {}
    for found in close_casters.measure(close_casters.LAMPS, close_casters.FIXTURES, radii, METHODS, size):
        rows.setdefault((found.lamp, found.fixture, found.method), []).append(rmse(found.rmse))
    samples = 16 if quick else 256
    against = [
        [*what, method, rmse(found.rmse), rmse(found.cycles_noise), f"{found.bias:+.4f}", f"{found.p99:.3f}"]
        for what, method, found in close_casters.by_cycles(samples, METHODS[:2], size)
    ]
    return "\n\n".join(
        [
            "### Close to spots and points",
            f"A lamp {close_casters.HEIGHT_M:g} m above a ground and, in proportion to its radius (at least "
            "0.1 m), what an artist puts close to it: a plate with holes one radius below, barn doors, a "
            "cylinder of 1.5 and a cone of 1.2 to 2.4 radii about it, a window frame 1.3 radii before it; or "
            f"a plate of 2.4 m, 1 m below. Default settings but the method, {size[0]}x{size[1]}; against "
            f"{close_casters.RAYS} rays from every point: RMSE by the lamp's radius in metres.",
            table(
                ["lamp", "close to it", "method", *(f"{radius:g}" for radius in radii)],
                [[*key, *figures] for key, figures in rows.items()],
            ),
            "A lamp of no size has hard edges: a point within a texel of one may fall to either side, and "
            f"of these few points each that does counts .01. Some against Cycles, 2 x {samples} samples, "
            "its noise taken off:",
            table(
                ["lamp", "close to it", "radius", "method", "RMSE", "Cycles' noise", "bias", "p99"], against
            ),
        ]
    )


def random_scenes(quick: bool) -> str:
    """Reported intervals against the errors of all pixels."""
    return intervals.section(2 if quick else intervals.SCENES)


SECTIONS = {
    "intervals": random_scenes,
    "targets": targets.section,
    "courtyard": courtyard,
    "plates": closed_forms,
    "placement": placement.section,
    "close": close,
    "in_use": used,
    "reading": reading.section,
    "radiance": radiance,
    "toon": toon_shading,
    "volumetric": volumetric,
}


def main() -> None:
    """Reads the command line."""
    sections, quick = read_sections(__doc__, SECTIONS)
    for name in sections:
        text = SECTIONS[name](quick)
        print(f"\n{text}", flush=True)
        if not quick:
            write_block(DOCUMENT, name, text)


if __name__ == "__main__":
    main()
