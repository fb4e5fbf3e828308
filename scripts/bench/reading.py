"""Section "Scenes as Cycles reads them": random materials, hair and points, each layer held against Cycles as
`--audit` does it."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from functools import partial

import bpy
import numpy as np
from strata.addon.audit.audit import audited
from strata.addon.audit.other_blender import kept_scene
from strata.addon.bake import read_job
from strata.addon.planning import Options
from strata.scripts.bench.document import rmse, table
from strata.scripts.bench.random_materials import RandomMaterial, paint

SCENES = 30
SIZE = (240, 135)
ALLOWED = 0.01
"""Beyond the error that the bake's own rays find."""

MAKERS = (
    partial(bpy.ops.mesh.primitive_plane_add, size=1.6),
    partial(bpy.ops.mesh.primitive_grid_add, size=1.6),
    partial(bpy.ops.mesh.primitive_cube_add, size=0.9),
    partial(bpy.ops.mesh.primitive_uv_sphere_add, radius=0.6, segments=16, ring_count=10),
)
UNREADABLE = 0.25  # share of scenes with a material that nobody reads
DISPLACED = 0.25  # share of things whose vertices their material moves


@dataclass(frozen=True)
class Held:
    """A layer: what its report says, and what Cycles does. `high` is None where it is not known."""

    scene: int
    layer: str
    value: float
    low: float
    high: float | None
    is_unread: bool
    audit: float
    audit_low: float
    audit_high: float

    @property
    def beyond(self) -> float:
        return self.audit - self.value

    @property
    def is_held(self) -> bool:
        """Whether the report's interval and Cycles' have anything in common."""
        return self.low <= self.audit_high and (self.high is None or self.audit_low <= self.high)


def build(seed: int) -> None:
    """A random scene in a new file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, chance = bpy.context.scene, random.Random(seed)
    more = random.Random(f"{seed}, of objects and vertices")
    scene.render.engine = "CYCLES"
    bpy.ops.mesh.primitive_plane_add(size=30.0)
    unreadable = chance.random() < UNREADABLE
    for number in range(chance.randint(2, 6)):
        place = chance.uniform(-2.5, 2.5), chance.uniform(-2.0, 3.0), chance.uniform(0.6, 2.0)
        turn = tuple(chance.uniform(0.0, math.tau) for _ in range(3))
        chance.choice(MAKERS)(location=place, rotation=turn)
        item = bpy.context.object
        paint(item.data, chance)
        made = RandomMaterial(chance, unreadable and number == 0)
        item.data.materials.append(made.material)
        item.shadow_terminator_geometry_offset = more.choice((0.0, 0.1, 0.1, 0.5))
        if more.random() < DISPLACED:
            made.displace(more.uniform(-0.2, 0.2))
        if chance.random() < 0.5:
            bpy.ops.object.shade_smooth()
    if chance.random() < 0.3:
        _hair(scene, chance)
    if chance.random() < 0.3:
        _points(scene, chance)
    for _ in range(chance.choice((1, 1, 2))):
        _lamp(scene, chance)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, -8.0, 4.5), (1.1, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera


def _lamp(scene, chance: random.Random) -> None:
    kind = chance.choice(("POINT", "SUN", "SPOT", "AREA"))
    light = bpy.data.lights.new(kind, kind)
    light.energy = {"SUN": 3.0}.get(kind, 300.0)
    if kind == "AREA":
        light.size = chance.uniform(0.2, 2.0)
    elif kind == "SUN":
        light.angle = chance.choice((0.0, 0.01, 0.1))
    else:
        light.shadow_soft_size = chance.choice((0.0, 0.05, 0.3))
    if kind == "SPOT":
        light.spot_size = 1.8
    item = bpy.data.objects.new(kind, light)
    item.location = chance.uniform(-3.0, 3.0), chance.uniform(-3.0, 3.0), chance.uniform(4.0, 6.0)
    item.rotation_euler = -0.12 * item.location.y, 0.12 * item.location.x, 0.0
    scene.collection.objects.link(item)


def _hair(scene, chance: random.Random) -> None:
    """Bent strands on a disk."""
    count, steps = 200, 5
    rng = np.random.default_rng(chance.randrange(1 << 16))
    curves = bpy.data.hair_curves.new("Hair")
    curves.add_curves([steps] * count)
    roots = np.stack([rng.uniform(-0.6, 0.6, count), rng.uniform(-0.6, 0.6, count), np.zeros(count)], axis=1)
    along = np.linspace(0.0, 1.0, steps)
    lean = rng.normal(0.0, 0.3, (count, 3)) * (1.0, 1.0, 0.0)
    points = roots[:, None] + along[:, None] * (0.0, 0.0, 1.0) + (along**2)[:, None] * lean[:, None]
    curves.attributes["position"].data.foreach_set("vector", points.astype(np.float32).ravel())
    radii = curves.attributes.get("radius") or curves.attributes.new("radius", "FLOAT", "POINT")
    radii.data.foreach_set("value", np.full(count * steps, 0.02, np.float32))
    item = bpy.data.objects.new("Hair", curves)
    item.location = chance.uniform(-2.0, 2.0), chance.uniform(-1.5, 2.0), 0.0
    scene.collection.objects.link(item)


def _points(scene, chance: random.Random) -> None:
    """A cloud of small spheres."""
    count, rng = 60, np.random.default_rng(chance.randrange(1 << 16))
    cloud = bpy.data.pointclouds.new("Points")
    cloud.resize(count)
    cloud.attributes["position"].data.foreach_set(
        "vector", rng.normal(0.0, 0.4, 3 * count).astype(np.float32)
    )
    radii = cloud.attributes.get("radius") or cloud.attributes.new("radius", "FLOAT", "POINT")
    radii.data.foreach_set("value", np.full(count, 0.06, np.float32))
    item = bpy.data.objects.new("Points", cloud)
    item.location = chance.uniform(-2.0, 2.0), chance.uniform(-1.5, 2.0), chance.uniform(0.8, 1.6)
    scene.collection.objects.link(item)


def held(seed: int, samples: int = 16, probes: int = 1024, size: tuple[int, int] = SIZE) -> list[Held]:
    """Every lamp's shadow of one scene."""
    build(seed)
    scene = bpy.context.scene
    values = {"soft_shadow": {"method": "hybrid"}}
    options = Options(("soft_shadow",), "cpu", samples=samples, probes=probes, values=values)
    job = read_job(scene, scene.view_layers[0], lambda _: options, size=size)
    with kept_scene(scene, scene.view_layers[0]) as kept:
        baked = audited(job.result(), kept, job.outline, job.graph)
    found = []
    for layer in baked.layers.report["layers"]:
        error, audit = layer["error"], layer.get("audit")
        if audit is None:
            continue
        low, high = error["ci95"]
        is_unread = high is None or bool(error.get("unread"))
        figures = error["value"], low, high, is_unread, audit["value"], *audit["ci95"]
        found.append(Held(seed, layer["name"], *figures))
    return found


def section(quick: bool) -> str:
    """What Cycles says beside what reports say."""
    count = 2 if quick else SCENES
    rows = [row for seed in range(count) for row in held(seed, *((4, 64, (96, 54)) if quick else ()))]
    read, unread = ([row for row in rows if row.is_unread is each] for each in (False, True))
    lines = []
    if read:
        near = 100.0 * np.mean([row.beyond <= ALLOWED for row in read])
        worst = max(row.beyond for row in read)
        said = f"{near:.0f}% at most {ALLOWED:g} beyond what rays find; the worst {worst:+.4f}"
        lines.append(["nothing", *_medians(read), said])
    if unread:
        holds = 100.0 * np.mean([row.is_held for row in unread])
        lines.append(["opacities", *_medians(unread), f"the interval holds {holds:.0f}%"])
    text = (
        f"{count} random scenes of cards, grids, boxes and spheres whose materials are wired at random "
        "from what Strata reads (in a quarter of the scenes also from what it does not) and move vertices of "
        "a quarter of the things, with shadow terminator offsets of 0, .1 and .5, of hair and "
        f"point clouds, under lamps of all types; {SIZE[0]}x{SIZE[1]}, 16 samples, hybrid, 1024 probes. "
        "Each layer is held against Cycles, as `--audit` does it."
    )
    header = ["unread", "layers", "reported, median", "Cycles, median", "agreement"]
    return "\n\n".join(["### Scenes as Cycles reads them", text, table(header, lines)])


def _medians(rows: list[Held]) -> list:
    medians = (float(np.median([getattr(row, name) for row in rows])) for name in ("value", "audit"))
    return [len(rows), *map(rmse, medians)]


if __name__ == "__main__":
    import sys

    for seed in range(*map(int, sys.argv[1:])):
        for row in held(seed):
            mark = "" if (row.is_held if row.is_unread else row.beyond <= ALLOWED) else "  <----"
            print(row, f"{row.beyond:+.4f}", mark, flush=True)
