"""The courtyard with its baked shadows and an engine of known values, for tests of compositor nodes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
import pytest
import strata
from strata.addon.scene.open import open_blend
from strata.tests.support.exr_layers import read_layers
from strata.tests.support.places import SAMPLES

SIZE = (32, 18)
COMBINED, GROUP, NOISY = 0.8, 0.1, 0.6
"""In each pixel of the flat engine's passes."""


class FlatEngine(bpy.types.RenderEngine):
    """Stands in for Cycles: a pass has one value, so that what nodes do is known to a few roundings."""

    bl_idname = "FLAT"
    bl_label = "Flat"
    has_groups = True
    is_denoised = False
    size = SIZE

    @classmethod
    def passes(cls, view_layer) -> dict[str, float]:
        names = [f"Combined_{group.name}" for group in view_layer.lightgroups] if cls.has_groups else []
        return dict.fromkeys(names, GROUP) | ({"Noisy Image": NOISY} if cls.is_denoised else {})

    def update_render_passes(self, scene=None, renderlayer=None):
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        for name in self.passes(renderlayer):
            self.register_pass(scene, renderlayer, name, 3, "RGB", "COLOR")

    def render(self, depsgraph):
        layer = depsgraph.view_layer.name
        values = self.passes(depsgraph.view_layer)
        for name in values:
            self.add_pass(name, 3, "RGB", layer=layer)
        result = self.begin_result(0, 0, *self.size, layer=layer)
        for found in result.layers[0].passes:
            value = np.full(
                (self.size[0] * self.size[1], found.channels), values.get(found.name, COMBINED), np.float32
            )
            found.rect.foreach_set(value.reshape(-1))
        self.end_result(result)


@contextmanager
def flat_engine() -> Iterator[None]:
    """Strata and the flat engine are registered."""
    strata.register()
    bpy.utils.register_class(FlatEngine)
    yield
    bpy.utils.unregister_class(FlatEngine)
    strata.unregister()


def small(scene, output) -> None:
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.strata.backend, scene.strata.samples, scene.strata.probes = "cpu", 1, 0
    scene.strata.save_to, scene.strata.output = "FILE", str(output)


def bake_courtyard(folder: Path) -> Path:
    """A Blender file in the folder, whose output is a file beside it."""
    open_blend(SAMPLES / "courtyard.blend")
    scene = bpy.context.scene
    scene.render.engine = "FLAT"
    small(scene, folder / "baked.exr")
    assert bpy.ops.strata.bake() == {"FINISHED"}
    scene.strata.output = "//baked.exr"
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"), relative_remap=False)
    return folder


def opened(folder: Path) -> bpy.types.Scene:
    """The courtyard, as it was baked."""
    FlatEngine.has_groups, FlatEngine.is_denoised = True, False
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))
    return bpy.context.scene


def shadows(scene) -> dict[str, np.ndarray]:
    path = bpy.path.abspath(scene.strata.output)
    return {la.light: la.pixels for la in read_layers(path).layers if la.effect == "soft_shadow"}


def lamps(scene) -> dict[str, bpy.types.Object]:
    return {thing.name: thing for thing in scene.objects if thing.type == "LIGHT"}


def composited(scene, tmp_path) -> np.ndarray:
    settings = scene.render.image_settings
    settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGBA"
    path = tmp_path / "composited.exr"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True, scene=scene.name)
    with OpenEXR.File(str(path)) as file:
        return file.channels()["RGBA"].pixels[::-1].copy()


def summed(*masks: np.ndarray) -> np.ndarray:
    """What the nodes make of the flat engine's render."""
    return COMBINED + GROUP * sum(mask - 1.0 for mask in masks)


def expect(image: np.ndarray, expected: np.ndarray) -> None:
    for channel in range(3):
        np.testing.assert_allclose(image[:, :, channel], expected, atol=1e-6)  # a few roundings of float32
    assert np.ptp(expected) > 0.05


def built(capfd, **arguments) -> list[str]:
    """What pressing the button says, a line each."""
    return told(capfd, bpy.ops.strata.build_compositor, **arguments)


def told(capfd, operator, **arguments) -> list[str]:
    capfd.readouterr()
    assert operator(**arguments) == {"FINISHED"}
    return [line.partition(": ")[2] for line in capfd.readouterr().out.splitlines() if ": " in line]


def refused(**arguments) -> str:
    with pytest.raises(RuntimeError) as error:
        bpy.ops.strata.build_compositor(**arguments)
    return str(error.value)


def everything(scene) -> list:
    """All that a press may change."""
    return [
        [
            (t.name, t.lightgroup, t.data.use_shadow, t.data.strata_shadow_composited)
            for t in lamps(scene).values()
        ],
        [(layer.name, [group.name for group in layer.lightgroups]) for layer in scene.view_layers],
        sorted((tree.name, len(tree.nodes), len(tree.links)) for tree in bpy.data.node_groups),
        sorted(image.name for image in bpy.data.images),
        getattr(scene.compositing_node_group, "name", None),
        scene.render.use_compositing,
    ]


def add_lamp(scene, kind: str, place, energy: float, **values) -> None:
    made = bpy.data.objects.new(kind.title(), bpy.data.lights.new(kind.title(), kind))
    made.location, made.data.energy = place, energy
    for name, value in values.items():
        setattr(made.data, name, value)
    scene.collection.objects.link(made)
