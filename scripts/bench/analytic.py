"""Writes docs/analytic.md: light known in closed form, as Strata delivers it and as Cycles renders it.

python -m strata.scripts.bench.analytic; about two minutes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from strata.addon.bake import bake
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.planning import Options
from strata.addon.ui import properties
from strata.scripts.bench.cycles import POINT_FILTER_WIDTH, alone, render_passes
from strata.scripts.bench.document import ROOT, table
from strata.tests.support.closed_forms import (
    disk_share_beyond_edge,
    irradiance_of_parallel_disk,
    irradiance_of_polygon,
    irradiance_of_sphere,
    visibility,
)

DOCUMENT = ROOT / "docs" / "analytic.md"
SIDE, SAMPLES, CYCLES_SAMPLES = 8, 64, 1024
UP = np.array([0.0, 0.0, 1.0])
POWER_W, SUN_W_PER_M2 = 100.0, 3.0
WIDE_M = 40.0  # of what stands for a half plane
ROUND_SIDES = 1024

HEAD = """# Light in closed form

What arrives at a point of a white diffuse ground is known exactly for simple lamps, and for simple things
in their way. This page has such cases, in the manner of CIE 171:2006 (Test Cases to Assess the Accuracy of
Lighting Computer Programs): point sources, form factors of disks, rectangles and spheres, a line, and suns
behind edges. Of each it says how far what is delivered is from the closed form: the composite's middle,
which is the lamp's light times its shadow layer, and what Cycles renders of the same file. Written by
`python -m strata.scripts.bench.analytic`.

The picture has {side} x {side} pixels that lie within a millimetre. Strata: {samples} samples a pixel,
otherwise default settings, on the CPU. Cycles: {cycles} samples, point sampled, no bounces. Both are means
over the pixels; *noise* is the standard error of that mean, with what differs within the millimetre. Errors
are shares of the truth. *Closed form* is the irradiance, W/m².

What errs by more than its noise is the unshadowed light of the composite: the mean over sixteen places on
the lamp. It is in the composite, and in what samples weigh; a shadow layer is multiplied onto the light of
whatever renders it.
"""

TAIL = """
Sky: not yet, as no layer has the world's light.
"""


@dataclass(frozen=True)
class Case:
    """`lamp`: kind, settings, place and turn; `plates`: polygons (K, 3) in its way; `irradiance_w_per_m2` at
    the origin, facing up, by `source`."""

    name: str
    lamp: tuple[str, dict[str, Any], tuple, tuple]
    irradiance_w_per_m2: float
    source: str
    plates: list[np.ndarray] = field(default_factory=list)


def rectangle(x0, x1, y0, y1, z) -> np.ndarray:
    return np.array([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], np.float64)


def disk(radius: float, z: float) -> np.ndarray:
    """A polygon of the disk's area."""
    turn = 2.0 * math.pi * np.arange(ROUND_SIDES) / ROUND_SIDES
    equal = radius * math.sqrt((2.0 * math.pi / ROUND_SIDES) / math.sin(2.0 * math.pi / ROUND_SIDES))
    return np.column_stack([equal * np.cos(turn), equal * np.sin(turn), np.full(ROUND_SIDES, z)])


def area(width: float, height: float, place, turn=(0.0, 0.0, 0.0), shape="RECTANGLE"):
    return "AREA", {"energy": POWER_W, "shape": shape, "size": width, "size_y": height}, place, turn


def point(radius: float, place):
    settings = {"energy": POWER_W, "shadow_soft_size": radius, "use_soft_falloff": False}
    return "POINT", settings, place, (0.0, 0.0, 0.0)


def sun(degrees: float, tilt: float = 0.0):
    settings = {"energy": SUN_W_PER_M2, "angle": math.radians(degrees)}
    return "SUN", settings, (0.0, 0.0, 10.0), (0.0, math.radians(tilt), 0.0)


def radiance_of_area(square_metres: float) -> float:
    """W/(m² sr): a lamp of Blender's shines from one side, evenly by Lambert's law."""
    return POWER_W / (math.pi * square_metres)


def corner(width: float, length: float, height: float) -> float:
    """E at radiance 1 of a rectangle parallel to the surface with one corner straight above the point
    (Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-3)."""
    a, b = width / height, length / height
    u, v = math.hypot(1.0, a), math.hypot(1.0, b)
    return 0.5 * (a / u * math.atan(b / u) + b / v * math.atan(a / v))


def line(half_length: float, height: float) -> float:
    """E at radiance 1 and width 1 m of a line of Lambertian strips straight above, facing down: the integral
    of h² / (h² + x²)²."""
    h, x = height, half_length
    return x / (h * h + x * x) + math.atan(x / h) / h


def cases() -> list[Case]:
    intensity = POWER_W / (4.0 * math.pi)
    sphere = POWER_W / (4.0 * math.pi**2)  # radiance times r²
    side_lamp = np.array([(1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0), (1.0, 0.0, 1.0)])
    turned = (0.0, math.radians(35.0), 0.0)
    right = np.array([math.cos(turned[1]), 0.0, -math.sin(turned[1])])
    tilted = np.array([-1.0, 0.3, 2.0]) + [
        0.5 * (i * 1.2 * right + j * 0.8 * np.array([0.0, 1.0, 0.0]))
        for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    disk_m2, lamp_m2 = math.pi * 0.5**2, 1.2 * 0.8
    found = [
        Case("point 2 m above", point(0.0, (0, 0, 2)), intensity / 4.0, "inverse square"),
        Case(
            "point 2 m away, 60 degrees from the normal",
            point(0.0, (2 * math.sin(math.pi / 3), 0, 1)),
            intensity / 8.0,
            "inverse square, cosine",
        ),
        Case(
            "spot 2 m above, in its cone",
            ("SPOT", {"energy": POWER_W, "shadow_soft_size": 0.0, "spot_blend": 0.0}, (0, 0, 2), (0, 0, 0)),
            intensity / 4.0,
            "inverse square",
        ),
        Case(
            "sphere of 0.5 m, 2 m away, 60 degrees from the normal",
            point(0.5, (2 * math.sin(math.pi / 3), 0, 1)),
            sphere / 0.25 * float(irradiance_of_sphere(2.0, 0.5, 0.5)),
            "pi r²/d² cos",
        ),
        Case(
            "sphere of 0.5 m, 2 m away, half below the horizon",
            point(0.5, (2, 0, 0)),
            sphere / 0.25 * (math.asin(0.25) - 0.25 * math.sqrt(1.0 - 0.25**2)),
            "a - sin a cos a",
        ),
        Case(
            "disk of 0.5 m, 2 m above",
            area(1.0, 1.0, (0, 0, 2), shape="DISK"),
            radiance_of_area(disk_m2) * float(irradiance_of_parallel_disk(2.0, 0.0, 0.5)),
            "coaxial disk",
        ),
        Case(
            "disk of 0.5 m, 2 m above, 1.5 m aside",
            area(1.0, 1.0, (1.5, 0, 2), shape="DISK"),
            radiance_of_area(disk_m2) * float(irradiance_of_parallel_disk(2.0, 1.5, 0.5)),
            "parallel disk (Howell)",
        ),
        Case(
            "rectangle of 1.2 x 0.8 m, a corner 1 m above",
            area(1.2, 0.8, (0.6, 0.4, 1.0)),
            radiance_of_area(lamp_m2) * corner(1.2, 0.8, 1.0),
            "Howell B-3",
        ),
        Case(
            "square of 1 m standing on the ground, 1 m away",
            area(1.0, 1.0, (1.0, 0.5, 0.5), (0.0, math.radians(90.0), 0.0)),
            radiance_of_area(1.0) * irradiance_of_polygon(np.zeros(3), UP, side_lamp),
            "Lambert's polygon",
        ),
        Case(
            "rectangle of 1.2 x 0.8 m, aside and turned by 35 degrees",
            area(1.2, 0.8, (-1.0, 0.3, 2.0), turned),
            radiance_of_area(lamp_m2) * irradiance_of_polygon(np.zeros(3), UP, tilted),
            "Lambert's polygon",
        ),
        Case(
            "line of 2 m, 1 mm wide, 1 m above",
            area(2.0, 0.001, (0, 0, 1)),
            radiance_of_area(0.002) * 0.001 * line(1.0, 1.0),
            "line of strips",
        ),
        Case(
            "rectangle of 1.2 x 0.8 m, 2 m above, half of it behind an edge",
            area(1.2, 0.8, (0, 0, 2)),
            0.5 * radiance_of_area(lamp_m2) * 4.0 * corner(0.6, 0.4, 2.0),
            "Howell B-3, a half",
            [rectangle(0.0, WIDE_M, -WIDE_M, WIDE_M, 1.0)],
        ),
        Case(
            "disk of 0.5 m, 2 m above, behind one of 0.1 m, 1 m above",
            area(1.0, 1.0, (0, 0, 2), shape="DISK"),
            radiance_of_area(disk_m2)
            * float(irradiance_of_parallel_disk(2.0, 0.0, 0.5) - irradiance_of_parallel_disk(1.0, 0.0, 0.1)),
            "coaxial disks",
            [disk(0.1, 1.0)],
        ),
        Case("sun of 0.5 degrees, overhead", sun(0.5), SUN_W_PER_M2, "its strength"),
        Case("sun of 0.5 degrees, 60 degrees down", sun(0.5, 60.0), 0.5 * SUN_W_PER_M2, "cosine"),
    ]
    return found + [
        behind_edge(height_m, share) for height_m in (0.5, 2.0, 8.0) for share in (-0.5, 0.0, 0.7)
    ]


def behind_edge(height_m: float, offset: float) -> Case:
    """A sun of 6 degrees overhead, and an edge so high, `offset` of the sun's radius beside its middle."""
    slope = math.tan(math.radians(3.0))
    plate = rectangle(offset * slope * height_m, WIDE_M, -WIDE_M, WIDE_M, height_m)
    axes = {"right": (1.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0), "forward": (0.0, 0.0, -1.0)}
    emitter = Emitter(EmitterKind.DISTANT_DISK, (0.0, 0.0, 0.0), **axes, half_width=slope, half_height=slope)
    share = float(visibility(emitter, np.zeros((1, 3)), UP[None], [plate])[0][0])
    assert abs(share - (1.0 - disk_share_beyond_edge(offset))) < 2e-3  # the small sun's
    name = (
        f"sun of 6 degrees behind an edge {height_m:g} m above, {offset:+g} of its radius beside its middle"
    )
    return Case(name, sun(6.0), share * SUN_W_PER_M2, "share of a disk", [plate])


def scene_of(case: Case) -> tuple[bpy.types.Scene, bpy.types.Object]:
    """White ground, the lamp, what is in its way, and a camera that sees a millimetre around the origin."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    white = bpy.data.materials.new("White")
    nodes = white.node_tree.nodes
    nodes.clear()
    diffuse, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    diffuse.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    white.node_tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    # Not a square about the origin: rays through just the edge of its two triangles slip through in Cycles.
    for name, polygon in [
        ("Ground", rectangle(-3.0, 3.7, -3.3, 3.0, 0.0)),
        *(("Plate", each) for each in case.plates),
    ]:
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(polygon.tolist(), [], [tuple(range(len(polygon)))])
        mesh.materials.append(white)
        scene.collection.objects.link(bpy.data.objects.new(name, mesh))
    kind, settings, place, turn = case.lamp
    data = bpy.data.lights.new("Lamp", kind)
    for name, value in settings.items():
        setattr(data, name, value)
    lamp = bpy.data.objects.new("Lamp", data)
    lamp.location, lamp.rotation_euler = place, turn
    eye = bpy.data.cameras.new("Camera")
    eye.type, eye.ortho_scale, eye.clip_start = "ORTHO", 1e-3, 1e-3
    camera = bpy.data.objects.new("Camera", eye)
    camera.location = (0.0, 0.0, 0.05)
    for thing in (lamp, camera):
        scene.collection.objects.link(thing)
    scene.camera = camera
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    bpy.context.view_layer.update()
    return scene, lamp


def by_strata(scene: bpy.types.Scene, _lamp) -> np.ndarray:
    """Irradiance by pixel: a white surface's radiance is 1/pi of it."""
    options = Options(("soft_shadow",), "cpu", samples=SAMPLES, probes=0, composite=True)
    baked = bake(scene, bpy.context.view_layer, options, size=(SIDE, SIDE))
    return math.pi * baked.composite[..., 0].astype(np.float64)


def by_cycles(scene: bpy.types.Scene, lamp: bpy.types.Object) -> np.ndarray:
    settings = alone(scene, lamp, CYCLES_SAMPLES, 0, (SIDE, SIDE), POINT_FILTER_WIDTH)
    (image,), _ = render_passes(scene, settings, ("Combined",))
    return math.pi * image[..., 0].astype(np.float64)


def measured(case: Case, by: Callable) -> list[str]:
    """Error and noise, as shares of the truth."""
    values = by(*scene_of(case)) / case.irradiance_w_per_m2
    noise = values.std() / math.sqrt(values.size)
    return [f"{values.mean() - 1.0:+.5f}", f"{noise:.5f}"]


def main() -> None:
    properties.register()
    rows = []
    for case in cases():
        row = [case.name, case.source, f"{case.irradiance_w_per_m2:.6g}"]
        rows.append(row + measured(case, by_strata) + measured(case, by_cycles))
        print(*rows[-1], sep="\t", flush=True)
    header = ["case", "known by", "closed form", "Strata", "noise", "Cycles", "noise"]
    head = HEAD.format(side=SIDE, samples=SAMPLES, cycles=CYCLES_SAMPLES)
    DOCUMENT.write_text(f"{head}\n{table(header, rows)}\n{TAIL}", encoding="utf-8")


if __name__ == "__main__":
    main()
