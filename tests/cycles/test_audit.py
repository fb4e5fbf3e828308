"""Audits: other Blenders render, and what they say is right."""

from __future__ import annotations

import json
import time
from pathlib import Path

import bpy
import pytest
import strata
from strata.addon.audit import audit as module
from strata.addon.audit import other_blender
from strata.addon.audit.audit import audited
from strata.addon.audit.other_blender import kept_scene
from strata.addon.bake import BakeJob, read_job
from strata.addon.core.errors import Cancelled
from strata.addon.measure.report_text import format_table
from strata.addon.planning import Options
from strata.addon.scene.open import open_blend
from strata.addon.ui.state import STATE
from strata.ops.cli import main
from strata.tests.support.places import SAMPLES

RIGHT = 0.03
"""What shadows by rays may be off at 16 samples and a size at which a pixel is a quarter of the plate's
penumbra; half a pixel's displacement of the audit's picture makes .05."""


def job_of(size, effects=("soft_shadow",), **more) -> BakeJob:
    scene = bpy.context.scene
    options = Options(
        effects, "cpu", samples=16, probes=0, values={"soft_shadow": {"method": "hybrid"}}, **more
    )
    return read_job(scene, scene.view_layers[0], lambda _: options, size=size)


def audits(job: BakeJob, **more) -> dict[str, dict]:
    scene = bpy.context.scene
    baked = job.result()
    with kept_scene(scene, scene.view_layers[0]) as kept:
        found = audited(baked, kept, job.outline, job.graph, **more)
    assert found.layers.report["warnings"] == list(found.report.warnings)
    assert all(a is b for a, b in zip(found.layers.layers, baked.layers.layers, strict=True))
    return {layer["name"]: layer.get("audit") for layer in found.layers.report["layers"]}


def command(scene: Path, out: Path, report: Path, size: str, samples: int, probes: int) -> list[str]:
    """Words that bake and audit on the CPU."""
    words = ["bake", str(scene), "-o", str(out), "--audit", "--report", str(report), "--backend", "cpu"]
    return [*words, "--size", size, "--samples", str(samples), "--probes", str(probes)]


@pytest.fixture
def plate():
    """A plate over a ground, both to be seen, in an unsaved file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    for side, height in ((20.0, 0.0), (1.0, 1.0)):
        bpy.ops.mesh.primitive_plane_add(size=side, location=(0.0, 0.0, height), rotation=(0.0, 0.0, 0.3))
    bpy.ops.object.light_add(type="AREA", location=(1.0, 0.5, 4.0))
    bpy.context.object.data.energy = 500.0
    bpy.ops.object.camera_add(location=(0.4, -5.0, 5.0), rotation=(0.78, 0.0, 0.0))
    scene.camera = bpy.context.object
    return scene


VIEWS = {
    "perspective": {},
    "shifted, upright": {"shift_x": 0.1, "shift_y": 0.05, "size": (90, 160)},
    "orthographic": {"type": "ORTHO", "ortho_scale": 5.0},
    "a region": {"region": (0.2, 0.9, 0.1, 0.7)},
    "pixels that are not square": {"pixel_aspect": 1.5},
}


@pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)
def test_what_is_read_right_agrees(plate, view):
    view, data, render = dict(view), plate.camera.data, plate.render
    size = view.pop("size", (160, 90))
    render.pixel_aspect_y = view.pop("pixel_aspect", 1.0)
    if region := view.pop("region", None):
        render.use_border = True
        render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = region
    for name, value in view.items():
        setattr(data, name, value)
    (found,) = audits(job_of(size)).values()
    assert found["value"] < RIGHT
    assert found["pixels"] > 500
    assert found["noise"] < 0.01


def test_what_strata_does_not_read_shows(plate):
    """Its own rays see the scene as it read it; only Cycles knows better."""
    plate_object = plate.objects["Plane.001"]
    material = bpy.data.materials.new("Unreadable")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    mix, clear = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfTransparent")
    noise, white = tree.nodes.new("ShaderNodeTexVoronoi"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    for source, target in (
        (noise.outputs["Distance"], mix.inputs[0]),
        (clear.outputs[0], mix.inputs[1]),
        (white.outputs[0], mix.inputs[2]),
        (mix.outputs[0], output.inputs["Surface"]),
    ):
        tree.links.new(source, target)
    plate_object.data.materials.append(material)
    (found,) = audits(job_of((160, 90))).values()
    assert found["ci95"][0] > RIGHT


def test_lamps_are_held_against_their_own_light_and_fog_against_fog():
    """One lamp's shadow is not another's, and media come and go between the two kinds of renders."""
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLES / "mist.blend"))
    found = audits(job_of((120, 68), ("soft_shadow", "volumetric_light")))
    assert found.pop("Transmittance") is None
    assert len(found) == 6
    for name, audit in found.items():
        # mist's own: docs/accuracy.md, "Lamps in use", whose sun is off where two faces lie in one plane.
        assert audit["value"] < 0.06 + 0.5 * audit["noise"], name
    assert bpy.data.filepath == str(SAMPLES / "mist.blend")


def test_swapped_layers_show(plate):
    bpy.ops.object.light_add(type="POINT", location=(-2.0, 0.0, 3.0))
    job = job_of((96, 54))
    first, second = job.result().layers.layers
    kept = first.pixels.copy()
    first.pixels[:], second.pixels[:] = second.pixels, kept
    assert all(found["ci95"][0] > RIGHT for found in audits(job).values())


def test_instances_of_a_lamp_are_told(plate):
    inside = bpy.data.collections.new("Inside")
    lamp = next(item for item in plate.objects if item.type == "LIGHT")
    inside.objects.link(lamp)
    for x in (-1.0, 1.0):
        shower = bpy.data.objects.new("Shower", None)
        shower.instance_type, shower.instance_collection = "COLLECTION", inside
        shower.location.x = x
        plate.collection.objects.link(shower)
    job = job_of((32, 18))
    with kept_scene(plate, plate.view_layers[0]) as kept:
        found = audited(job.result(), kept, job.outline, job.graph)
    assert all(layer.audit is None for layer in found.report.layers)
    assert any("instances show its lamp" in warning for warning in found.report.warnings)


def test_what_python_changed_is_seen(plate, tmp_path):
    """In the background Blender does not notice that what is open differs from its file."""
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.data.objects["Plane.001"].location.x += 1.0
    (found,) = audits(job_of((160, 90))).values()
    assert found["value"] < RIGHT


def test_drivers_that_are_trusted_are_trusted_there_too(plate, tmp_path):
    item = bpy.data.objects["Plane.001"]
    driver = item.driver_add("location", 0).driver
    driver.expression = "sum(range(1, 2)) + 0 * frame"  # needs Python
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    report = tmp_path / "report.json"
    words = command(tmp_path / "scene.blend", tmp_path / "out.exr", report, "160x90", samples=16, probes=0)
    assert main([*words, "--trust-scripts", "--set", "soft_shadow.method=hybrid"]) == 0
    (layer,) = json.loads(report.read_text())["layers"]
    assert layer["audit"]["value"] < RIGHT


def test_a_linked_scene_and_its_own_camera(plate, tmp_path):
    """There is a local camera of the same name, which looks elsewhere."""
    bpy.data.objects["Camera"].name = "Eye"
    library = tmp_path / "library.blend"
    plate.name = "Linked"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_there, here):
        here.scenes = ["Linked"]
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Eye", bpy.data.cameras.new("Eye")))
    scene = next(each for each in bpy.data.scenes if each.name == "Linked")
    options = Options(
        ("soft_shadow",), "cpu", samples=16, probes=0, values={"soft_shadow": {"method": "hybrid"}}
    )
    job = read_job(scene, scene.view_layers[0], lambda _: options, size=(160, 90))
    with kept_scene(scene, scene.view_layers[0]) as kept:
        found = audited(job.result(), kept, job.outline, job.graph)
    (layer,) = found.report.layers
    assert layer.audit is not None, found.report.warnings
    assert layer.audit.value < RIGHT


def test_a_copy_that_cannot_be_saved_costs_no_layer(monkeypatch, tmp_path):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(other_blender.tempfile, "TemporaryDirectory", full)
    report, out = tmp_path / "report.json", tmp_path / "out.exr"
    assert main(command(SAMPLES / "stacked.blend", out, report, "32x18", samples=1, probes=0)) == 0
    assert out.is_file()
    assert any(
        "not held against Cycles: no copy" in each for each in json.loads(report.read_text())["warnings"]
    )


def test_a_program_that_fails_costs_no_layer(plate, monkeypatch, tmp_path):
    broken = tmp_path / "program.py"
    broken.write_text("raise SystemExit('no Cycles here')\n", encoding="utf-8")
    monkeypatch.setattr(module, "PROGRAM", broken)
    job = job_of((32, 18))
    baked = job.result()
    with kept_scene(plate, plate.view_layers[0]) as kept:
        found = audited(baked, kept, job.outline, job.graph)
    assert len(found.layers.layers) == len(baked.layers.layers) == 1
    assert "held against" in format_table(found.report)
    (warning,) = (w for w in found.report.warnings if "Cycles" in w)
    assert warning == "not held against Cycles: the other Blender rendered nothing (no Cycles here)"


def test_it_can_be_cancelled(plate, monkeypatch, tmp_path):
    slow = tmp_path / "program.py"
    slow.write_text("import time\ntime.sleep(60)\n", encoding="utf-8")
    monkeypatch.setattr(module, "PROGRAM", slow)
    job, started = job_of((32, 18)), time.monotonic()
    baked = job.result()
    with kept_scene(plate, plate.view_layers[0]) as kept, pytest.raises(Cancelled):
        audited(baked, kept, job.outline, job.graph, is_cancelled=lambda: True)
    assert not Path(kept.folder.name).exists()
    assert time.monotonic() - started < 30.0


def test_the_command_line_reports_it(tmp_path):
    report = tmp_path / "stacked.json"
    words = command(
        SAMPLES / "stacked.blend", tmp_path / "stacked.exr", report, "96x54", samples=2, probes=64
    )
    assert main(words) == 0
    (layer,) = json.loads(report.read_text())["layers"]
    low, high = layer["audit"]["ci95"]
    assert 0.0 <= low <= layer["audit"]["value"] <= high < 0.2


def test_the_panel_s_bake_reports_it_of_what_is_not_saved(tmp_path):
    """The lamp is moved after saving: Cycles sees the scene as it is now, and the file stays as it was."""
    strata.register()
    try:
        open_blend(SAMPLES / "stacked.blend")
        path = tmp_path / "scene.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
        before, scene = path.read_bytes(), bpy.context.scene
        scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 96, 54, 100
        settings = scene.strata
        settings.backend, settings.samples, settings.probes, settings.audit = "cpu", 8, 0, True
        scene.objects["Panel"].location.x += 1.0
        bpy.ops.ed.undo_push()
        assert bpy.ops.strata.bake() == {"FINISHED"}
        (layer,) = STATE.reports[scene.session_uid]["layers"]
        assert layer["audit"]["value"] < 2 * RIGHT
        assert path.read_bytes() == before
    finally:
        strata.unregister()
