"""The render engine in background: Blender's own output holds the bake's layers, bit for bit."""

from __future__ import annotations

import json
import re
import time

import bpy
import numpy as np
import OpenEXR
import pytest
import strata
from strata.addon.bake import BakeJob, read_scene
from strata.addon.core.errors import Cancelled
from strata.addon.engine import compatible_panels, material_preview
from strata.addon.engine.engine import StrataRenderEngine
from strata.addon.planning import Options
from strata.addon.scene.exact import reading
from strata.addon.scene.exact.store import Store
from strata.addon.scene.open import choose, open_blend
from strata.ops.cli import main
from strata.tests.support.exr_layers import read_layers
from strata.tests.support.places import SAMPLES
from strata.tests.support.procedural import card, clear_by, floor_scene, noise
from strata.tests.support.render_passes import read_passes, write_multilayer

# 0.2 s is the promise; this is of the processor, whatever else it works at, and of all its cores.
SECONDS_TO_STOP = 1.0


@pytest.fixture(scope="module", autouse=True)
def registered():
    strata.register()
    yield
    strata.unregister()


@pytest.fixture
def scene():
    """A scene that moves, small, with the engine chosen."""
    open_blend(SAMPLES / "animated.blend")
    scene = bpy.context.scene
    scene.render.engine = "STRATA"
    scene.render.resolution_x, scene.render.resolution_y = 160, 90
    scene.render.resolution_percentage = 50
    scene.render.use_compositing = False
    scene.strata.backend, scene.strata.samples, scene.strata.probes = "cpu", 2, 0
    lamp = bpy.data.objects.new("Lamp.001", bpy.data.lights.new("Lamp", "POINT"))
    lamp.location, lamp.data.energy, lamp.data.shadow_soft_size = (1.5, -1.5, 3.0), 100.0, 0.2
    scene.collection.objects.link(lamp)
    return scene


def baked_by_the_command(tmp_path, frames="1", *words) -> dict[int, dict[str, np.ndarray]]:
    """Layers by `<view layer>.<pass>`, by frame, of the open scene as `strata bake` makes them.

    Leaves a copy of the scene open."""
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    output = tmp_path / "bake_####.exr"
    assert main(["bake", str(blend), "-o", str(output), "--frames", frames, "-q", *words]) == 0
    found = {}
    for path in sorted(tmp_path.glob("bake_*.exr")):
        layers = read_layers(path)
        found[int(path.stem[-4:])] = {f"{layers.view_layer}.{a.name}": a.pixels for a in layers.layers}
        path.unlink()
    return found


WHOLE = (slice(None), slice(None))


def assert_same_passes(
    rendered: dict[str, np.ndarray], baked: dict[str, np.ndarray], rendered_in=WHOLE
) -> None:
    """`rendered_in`: rows and columns that were rendered; Blender itself puts them into a frame of 0, while
    a bake's data window ends with them."""
    combined = {name for name in rendered if name.endswith(".Combined")}
    # A file has every pass that some frame may have; those that this one does not need are neutral.
    assert set(rendered) >= set(baked)
    for name in set(rendered) - combined - set(baked):
        scales = any(title in name for title in ("Soft Shadow", "Transmittance"))
        assert (rendered[name][rendered_in] == (1.0 if scales else 0.0)).all(), name
    for name, pixels in baked.items():
        ours = np.ascontiguousarray(rendered[name][rendered_in])
        np.testing.assert_array_equal(ours.view(np.uint32), pixels.view(np.uint32), name)


def test_animation_writes_the_bakes_layers_bit_for_bit(scene, tmp_path):
    scene.frame_start, scene.frame_end, scene.frame_step = 1, 13, 12
    write_multilayer(scene, tmp_path / "render_####.exr")
    bpy.ops.render.render(animation=True)
    rendered = {n: read_passes(tmp_path / f"render_{n:04d}.exr") for n in (1, 13)}
    baked = baked_by_the_command(tmp_path, "1,13")
    assert len(baked[1]) == 2
    for frame in (1, 13):
        assert_same_passes(rendered[frame], baked[frame])
        assert rendered[frame]["ViewLayer.Combined"].max() > 0.01
    moved = [name for name in baked[1] if (baked[1][name] != baked[13][name]).any()]
    assert moved, "the frames do not differ"


def test_all_frames_have_what_the_first_chose(scene, tmp_path):
    """Or their noise would flicker. Another render chooses anew."""
    scene.frame_start, scene.frame_end, scene.frame_step = 1, 13, 12
    scene.strata.target_error = 0.004
    write_multilayer(scene, tmp_path / "render_####.exr")
    bpy.ops.render.render(animation=True)
    chosen = [samples_in(tmp_path / f"render_{n:04d}.exr") for n in (1, 13)]
    assert chosen[0] == chosen[1]
    assert max(chosen[0].values()) > 4
    scene.strata.target_error = 0.1
    write_multilayer(scene, tmp_path / "again.exr")
    bpy.ops.render.render(write_still=True)
    assert set(samples_in(tmp_path / "again.exr").values()) == {4.0}


def test_frames_of_an_animation_that_miss_their_target_are_told_after_the_last(scene, tmp_path, capfd):
    scene.frame_start, scene.frame_end, scene.frame_step = 1, 13, 12
    settings = scene.strata
    settings.target_error, settings.most_samples, settings.probes = 1e-4, 4, 256
    write_multilayer(scene, tmp_path / "render_####.exr")
    bpy.ops.render.render(animation=True)
    told = capfd.readouterr()
    assert (told.out + told.err).count("The target error is not reached in 2 frames (1, 13): ") == 1


def samples_in(path) -> dict[str, float]:
    """Of the layers of a render's file."""
    header = OpenEXR.File(str(path), header_only=True).header()
    return {name: float(value) for name, value in header.items() if name.startswith("strata:samples.")}


@pytest.mark.parametrize("crop", [False, True])
def test_render_region_is_where_the_bake_has_it(scene, tmp_path, crop):
    render = scene.render
    render.use_border, render.use_crop_to_border = True, crop
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.3, 0.71, 0.2, 0.9
    write_multilayer(scene, tmp_path / "render.exr")
    bpy.ops.render.render(write_still=True)
    rendered = read_passes(tmp_path / "render.exr")
    (baked,) = baked_by_the_command(tmp_path, "1", "--exr-window", "frame" if crop else "region").values()
    assert_same_passes(rendered, baked, WHOLE if crop else (slice(9, 40), slice(24, 56)))
    width = rendered["ViewLayer.Combined"].shape[1]
    assert (width < 80) == crop
    assert crop or not rendered["ViewLayer.Combined"][:, :20].any()


def test_every_view_layer_has_its_own_passes(scene, tmp_path):
    other = scene.view_layers.new("Without lamp")
    lamps = bpy.data.collections.new("Lamps")
    scene.collection.children.link(lamps)
    lamp = bpy.data.objects["Lamp.001"]
    lamps.objects.link(lamp)
    scene.collection.objects.unlink(lamp)
    other.layer_collection.children["Lamps"].exclude = True
    write_multilayer(scene, tmp_path / "render.exr")
    bpy.ops.render.render(write_still=True)
    rendered = read_passes(tmp_path / "render.exr")
    baked = {}
    for name in ("ViewLayer", "Without lamp"):
        baked |= baked_by_the_command(tmp_path, "1", "--view-layer", name)[1]
    assert len(baked) == 3
    assert_same_passes(rendered, baked)


def headers(path) -> list[dict]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return [dict(part.header) for part in file.parts]


def test_the_report_reaches_the_file_whatever_blender_stamps(scene, tmp_path):
    scene.strata.probes = 64
    for name in dir(scene.render):
        if name.startswith("use_stamp"):
            setattr(scene.render, name, False)
    scene.view_layers.new("Other.Layer")
    write_multilayer(scene, tmp_path / "render.exr")
    bpy.ops.render.render(write_still=True)
    header = headers(tmp_path / "render.exr")[0]
    for view_layer in ("ViewLayer", "Other.Layer"):
        report = json.loads(header[f"strata:report.{view_layer}"])
        assert len(report["layers"]) == 2
        for layer in report["layers"]:
            said = f"{view_layer}.{layer['name']}"
            assert json.loads(header[f"strata:error.{said}"]) == layer["error"]
            assert float(header[f"strata:seconds.{said}"]) == pytest.approx(layer["seconds"], rel=1e-5)
            assert header[f"strata:light.{said}"] == layer["light"]


def test_a_bake_is_stamped_as_a_render_is(scene, tmp_path):
    scene.frame_set(7)
    scene.view_layers[0].name = "Main.Layer"
    write_multilayer(scene, tmp_path / "render.exr")
    bpy.ops.render.render(write_still=True)
    blender = headers(tmp_path / "render.exr")[0]
    scene.render.use_stamp_frame = scene.render.use_stamp_camera = False  # nor does a bake need these
    blend, output = tmp_path / "scene.blend", tmp_path / "bake.exr"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    assert main(["bake", str(blend), "-o", str(output), "-q", "--composite", "--exr-depth", "half"]) == 0
    first, *others = headers(output)
    assert first["name"] == "Main.Layer.Combined"
    for part in (first, *others):
        for name in ("Software", "Scene", "Camera", "Frame", "Time", "BlenderMultiChannel"):
            assert part[name] == blender[name], name
        assert part["File"] == str(blend)
        assert re.fullmatch(r"\d{4}(/\d\d){2} \d\d(:\d\d){2}", part["Date"])
    rendered = read_passes(tmp_path / "render.exr")["Main.Layer.Combined"]
    assert rendered.max() > 0.01
    half = read_passes(output)["Main.Layer.Combined"]
    np.testing.assert_array_equal(half, rendered.astype(np.float16))


def test_what_is_not_read_is_told_on_the_console(scene, capfd):
    scene.render.use_motion_blur = True
    scene.camera.data.dof.use_dof = True
    bpy.ops.render.render()
    lines = [line for line in capfd.readouterr().out.splitlines() if line.startswith("Warning: ")]
    assert sum("layers show one instant and do not fit what moves" in line for line in lines) == 1
    assert sum("layers are sharp and do not fit what it blurs" in line for line in lines) == 1


def test_stereo_gives_both_eyes_the_middle_one_and_says_so(scene, tmp_path, capfd):
    write_multilayer(scene, tmp_path / "mono.exr")
    bpy.ops.render.render(write_still=True)
    mono = read_passes(tmp_path / "mono.exr")
    scene.render.use_multiview = True
    scene.render.image_settings.views_format = "MULTIVIEW"
    scene.render.filepath = str(tmp_path / "stereo.exr")
    bpy.ops.render.render(write_still=True)
    captured = capfd.readouterr()
    assert captured.out.count("stereoscopy is not read") == 1
    assert "Traceback" not in captured.out + captured.err
    parts = set()
    with OpenEXR.File(str(tmp_path / "stereo.exr"), separate_channels=True) as file:
        for part in file.parts:
            parts.add((part.name(), part.header["view"]))
            for name, channel in part.channels.items():
                owner, _, letter = name.rpartition(".")
                planes = np.atleast_3d(mono[owner])
                plane = planes[:, :, "XYZ".index(letter) if letter in "XYZ" else "RGBAV".index(letter) % 4]
                np.testing.assert_array_equal(channel.pixels[::-1], plane, name)
    assert parts == {(f"{name}-{eye}", eye) for name in mono for eye in ("left", "right")}


def render_layers_tree(scene) -> bpy.types.Node:
    """Compositor nodes that pass one socket on, to be linked; the Render Layers node."""
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    scene.compositing_node_group = tree
    scene.render.use_compositing = True
    node = tree.nodes.new("CompositorNodeRLayers")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree.nodes.new("NodeGroupOutput")
    bpy.context.view_layer.update()
    return node


def composited(scene, node, socket: str, path) -> np.ndarray:
    """What the compositor makes of one pass."""
    tree = node.id_data
    tree.links.new(node.outputs[socket], tree.nodes["Group Output"].inputs[0])
    settings = scene.render.image_settings
    settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    with OpenEXR.File(str(path)) as file:
        return next(iter(file.channels().values())).pixels[::-1]


def test_compositor_sees_the_passes(scene, tmp_path):
    node = render_layers_tree(scene)
    assert "Soft Shadow Lamp_001" in node.outputs
    seen = composited(scene, node, "Soft Shadow Lamp_001", tmp_path / "composited.exr")
    (baked,) = baked_by_the_command(tmp_path).values()
    np.testing.assert_array_equal(seen[:, :, 0], baked["ViewLayer.Soft Shadow Lamp_001"])


def test_compositor_sees_shadows_in_colour_and_blender_writes_them(scene, tmp_path):
    node = render_layers_tree(scene)
    bpy.data.objects["Lamp.001"].data.color = (1.0, 0.5, 0.1)
    scene.strata.rgb_layers = True
    bpy.context.view_layer.update()
    assert node.outputs["Soft Shadow Lamp_001"].type == "RGBA"
    seen = composited(scene, node, "Soft Shadow Lamp_001", tmp_path / "composited.exr")
    (baked,) = baked_by_the_command(tmp_path).values()
    assert baked["ViewLayer.Soft Shadow Lamp_001"].shape[2] == 3
    np.testing.assert_array_equal(seen[:, :, :3], baked["ViewLayer.Soft Shadow Lamp_001"])


def test_compositor_gets_full_light_where_a_frame_needs_no_shadow(scene, tmp_path):
    """Blender gives 0 for a pass that a render does not have, and a shadow of 0 is black."""
    node = render_layers_tree(scene)
    bpy.data.objects["Lamp.001"].data.energy = 0.0
    assert "Soft Shadow Lamp_001" in node.outputs
    seen = composited(scene, node, "Soft Shadow Lamp_001", tmp_path / "composited.exr")
    assert (seen[:, :, 0] == 1.0).all()


def test_sockets_follow_lights_and_effects(scene):
    node = render_layers_tree(scene)

    def shadows() -> list[str]:
        bpy.context.view_layer.update()
        return sorted(s.name for s in node.outputs if s.name.startswith("Soft Shadow"))

    assert shadows() == ["Soft Shadow Lamp_001", "Soft Shadow Moving panel"]
    scene.strata.soft_shadow.enabled = False
    assert shadows() == []
    scene.strata.soft_shadow.enabled = True
    assert "Soft Shadow Lamp_001" in shadows()
    bpy.data.objects["Lamp.001"].name = "Renamed"
    assert shadows() == ["Soft Shadow Moving panel", "Soft Shadow Renamed"]
    bpy.data.objects["Renamed"].data.use_shadow = False
    assert shadows() == ["Soft Shadow Moving panel"]
    bpy.data.objects["Renamed"].data.use_shadow = True
    bpy.data.objects["Renamed"].hide_render = True
    assert shadows() == ["Soft Shadow Moving panel"]
    holder = bpy.data.objects.new("Holder", None)
    inner = bpy.data.collections.new("Inner")
    bulb = bpy.data.objects.new("Bulb", bpy.data.lights.new("Bulb", "POINT"))
    inner.objects.link(bulb)
    holder.instance_type, holder.instance_collection = "COLLECTION", inner
    scene.collection.objects.link(holder)
    assert shadows() == ["Soft Shadow Bulb Holder", "Soft Shadow Moving panel"]


def test_render_takes_animated_and_driven_settings(scene, tmp_path):
    settings = scene.strata.soft_shadow
    settings.method = "bitmask"
    settings.keyframe_insert("method", frame=1)
    settings.method = "area"
    settings.keyframe_insert("method", frame=13)
    driver = settings.driver_add("resolution").driver
    driver.expression = "128 + frame"
    scene.frame_start, scene.frame_end, scene.frame_step = 1, 13, 12
    write_multilayer(scene, tmp_path / "render_####.exr")
    bpy.ops.render.render(animation=True)
    rendered = {n: read_passes(tmp_path / f"render_{n:04d}.exr") for n in (1, 13)}
    for frame, method, resolution in ((1, "bitmask", 129), (13, "area", 141)):
        explicit = (f"soft_shadow.method={method}", f"soft_shadow.resolution={resolution}")
        words = [word for value in explicit for word in ("--set", value)]
        assert_same_passes(rendered[frame], baked_by_the_command(tmp_path, str(frame), *words)[frame])
        # The command evaluates at each frame too.
        assert_same_passes(rendered[frame], baked_by_the_command(tmp_path, str(frame))[frame])


def test_what_is_wrong_is_said_in_one_line(scene):
    scene.camera.data.type = "PANO"
    with pytest.raises(RuntimeError) as raised:
        bpy.ops.render.render()
    (line,) = str(raised.value).strip().splitlines()
    assert line.startswith(f"Error: camera '{scene.camera.name}' is panoramic")


class FakeEngine:
    """Stands in for the engine in a window, where Esc makes `test_break` true."""

    def __init__(self, seconds: float):
        self.pressed = time.process_time() + seconds
        self.progress = []

    def test_break(self):
        return time.process_time() > self.pressed

    def update_progress(self, share):
        self.progress.append(share)

    def update_stats(self, stats, info):
        assert info.startswith("Strata: ")


@pytest.mark.parametrize("seconds", [0.0, 0.3, 1.0])
def test_a_break_stops_at_once(seconds):
    open_blend(SAMPLES / "courtyard.blend")
    chosen = choose()
    options = Options(backend="cpu", samples=4096, composite=True)
    *read, _ = read_scene(chosen.scene, chosen.view_layer, options, size=(320, 180))
    engine, job = FakeEngine(seconds), BakeJob(*read, options)
    with pytest.raises(Cancelled):
        StrataRenderEngine._baked(engine, job, bpy.context.evaluated_depsgraph_get())
    assert time.process_time() - engine.pressed < SECONDS_TO_STOP
    assert engine.progress == sorted(engine.progress)


def test_material_preview_is_the_materials_colour():
    bpy.ops.wm.read_factory_settings()
    material = bpy.data.materials.new("Red")
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.8, 0.1, 0.0, 1.0)
    bpy.context.object.active_material = material
    picture = material_preview.picture(bpy.context.evaluated_depsgraph_get(), 64, 48)
    assert picture.shape == (48, 64, 4)
    assert picture[24, 32, 3] == 1.0
    assert picture[0, 0].tolist() == [0.0] * 4
    red, green, blue = picture[24, 32, :3]
    assert (red / green, blue) == (pytest.approx(8.0, rel=1e-4), 0.0)


def test_compatible_panels_come_and_go():
    def compatible() -> set[str]:
        panels = [panel for panel in compatible_panels._panels() if "STRATA" in panel.COMPAT_ENGINES]
        return {panel.__name__ for panel in panels if not panel.__name__.startswith("STRATA_")}

    there = compatible()
    assert there >= {"RENDER_PT_format", "RENDER_PT_output", "DATA_PT_lens", "DATA_PT_EEVEE_light"}
    assert there >= {"OBJECT_PT_visibility", "EEVEE_MATERIAL_PT_surface", "VIEWLAYER_PT_layer"}
    assert not there & {"RENDER_PT_eevee_sampling", "CYCLES_RENDER_PT_sampling", "DATA_PT_light"}
    strata.unregister()
    assert compatible() == set()
    own = [panel for panel in compatible_panels._panels() if panel.__name__.startswith("STRATA_")]
    assert own
    assert all("STRATA" in panel.COMPAT_ENGINES for panel in own)
    strata.register()
    assert compatible() == there


def test_what_blender_bakes_of_materials_is_there_in_a_render_too(tmp_path, monkeypatch):
    monkeypatch.setattr(reading, "STORE", Store(None))
    scene = floor_scene()
    card(clear_by("Card", noise))
    scene.render.engine = "STRATA"
    scene.render.resolution_x, scene.render.resolution_y = 80, 45
    scene.strata.backend, scene.strata.samples, scene.strata.probes = "cpu", 2, 0
    scene.strata.read = "exact"
    write_multilayer(scene, tmp_path / "render.exr")
    bpy.ops.render.render(write_still=True)
    opaque = read_passes(tmp_path / "render.exr")["ViewLayer.Soft Shadow Sun"]
    (baked,) = baked_by_the_command(tmp_path, "1").values()
    # It is kept now.
    write_multilayer(scene := bpy.context.scene, tmp_path / "render.exr")
    bpy.ops.render.render(write_still=True)
    assert_same_passes(read_passes(tmp_path / "render.exr"), baked)
    (shadow,) = baked.values()
    assert shadow.mean() > opaque.mean() + 0.05
