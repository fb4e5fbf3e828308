"""The ways in which an EXR can be written, read back with OpenEXR, OpenImageIO and Blender's compositor."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
import pytest
import strata
from strata.addon.core.errors import StrataError
from strata.addon.core.layers import Layer, LayerSet
from strata.addon.core.roles import Of
from strata.addon.layers import openimageio
from strata.addon.layers.exr import LARGEST_HALF, write_layers
from strata.addon.layers.exr_params import ExrParams
from strata.addon.scene.open import open_blend
from strata.tests.layers.made_layers import compositor_passes, largest_file
from strata.tests.support.places import SAMPLES

HEIGHT, WIDTH = 70, 90  # several blocks of both codecs, the last one short
STAMP = {"Software": "Blender 5.2.3 LTS", "Frame": "007", "Camera": "Camera", "Time": "00:00:00:07"}
WAYS = [(p, d, c) for p in ("multi", "single") for d in ("float", "half") for c in ("zip", "dwaa")]


def smooth(channels: str, seed: int) -> np.ndarray:
    """What a render looks like: waves and a little noise, in [0, 1]."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    noise = np.random.default_rng(seed).normal(0.0, 0.002, (HEIGHT, WIDTH, len(channels)))
    waves = 0.5 + 0.4 * np.sin(rows / 20.0 + seed)[:, :, None] * np.cos(columns / 15.0)[:, :, None]
    return np.squeeze((waves + noise).clip(0.0, 1.0).astype(np.float32))


def a_set() -> tuple[LayerSet, np.ndarray]:
    """A shadow, light, a depth that half would ruin and a layer of one value; and a composite."""
    depth = 100.0 + smooth("Z", 3)
    layers = (
        Layer("Soft Shadow Key", "V", smooth("V", 1), "soft_shadow", "Key", Of.lamp(0), 0.5, {"value": 0.01}),
        Layer("Glow", "RGB", smooth("RGB", 2), "glow", seconds=0.25),
        Layer("Depth", "Z", depth, "depth"),
        Layer("Soft Shadow Off", "V", np.broadcast_to(np.float32(1.0), (HEIGHT, WIDTH)), "soft_shadow"),
    )
    report = {"strata": "0.1.0", "warnings": ["one"]}
    return LayerSet(layers, WIDTH, HEIGHT, "View.Layer", report=report, stamp=STAMP), smooth("RGBA", 5)


def written(path: Path, parts: str, depth: str, codec: str, composite: bool = True):
    ours, picture = a_set()
    values = {"parts": parts, "depth": depth, "codec": codec, "composite": composite}
    assert write_layers(path, ours, ExrParams.checked("exr", values), picture) == ()
    return ours, picture


def tolerance(name: str, channels: str, depth: str, codec: str) -> float:
    if name == "Depth" or (depth == "float" and codec == "zip"):
        return 0.0
    if codec == "dwaa" and channels in ("RGB", "RGBA"):
        return 0.02  # its level 45 is made to be invisible; alpha and masks it keeps
    return 2.0**-12 if depth == "half" else 0.0  # half a unit of 10 bits below 1


@pytest.mark.parametrize(("parts", "depth", "codec"), WAYS)
def test_openexr_reads_what_was_written(tmp_path, parts, depth, codec):
    path = tmp_path / "out.exr"
    ours, picture = written(path, parts, depth, codec)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        found = {name: channel.pixels for part in file.parts for name, channel in part.channels.items()}
        headers = [dict(part.header) for part in file.parts]
        names = [part.name() for part in file.parts]
    expected = ["View.Layer.Combined", *(f"View.Layer.{layer.name}" for layer in ours.layers)]
    assert names == (expected if parts == "multi" else [""])
    combined = Layer("Combined", "RGBA", picture, "")
    assert len(found) == 4 + 1 + 3 + 1 + 1
    for layer in (combined, *ours.layers):
        for letter, plane in layer.planes():
            theirs = found[f"View.Layer.{layer.name}.{letter}"]
            is_half = depth == "half" and layer.name != "Depth"
            assert theirs.dtype == (np.float16 if is_half else np.float32), layer.name
            limit = tolerance(layer.name, layer.channels, depth, codec)
            np.testing.assert_allclose(theirs[::-1], plane, rtol=0, atol=limit, err_msg=layer.name)
    kind = OpenEXR.DWAA_COMPRESSION if codec == "dwaa" else OpenEXR.ZIP_COMPRESSION
    for header in headers:
        assert header["compression"] == kind
        assert {name: header[name] for name in STAMP} == STAMP
        assert header["BlenderMultiChannel"]
    assert json.loads(headers[0]["strata:report"]) == ours.report
    if parts == "single":
        assert headers[0]["strata:seconds.View.Layer.Soft Shadow Key"] == 0.5
        assert json.loads(headers[0]["strata:error.View.Layer.Soft Shadow Key"]) == {"value": 0.01}
        assert headers[0]["colorInteropID"] == "lin_rec709_scene"
    else:
        assert headers[1]["strata:seconds"] == 0.5
        assert headers[1]["strata:light"] == "Key"
        assert [header["colorInteropID"] for header in headers[:3]] == [
            "lin_rec709_scene",
            "data",
            "lin_rec709_scene",
        ]


@pytest.mark.parametrize(("parts", "depth", "codec"), WAYS)
def test_openimageio_and_blender_read_what_was_written(tmp_path, parts, depth, codec):
    path = tmp_path / "out.exr"
    ours, picture = written(path, parts, depth, codec)
    assert compositor_passes(path) == {"Combined", "Alpha", *(layer.name for layer in ours.layers)}
    source = openimageio.library().ImageInput.open(str(path))
    found, part = {}, 0
    while source.seek_subimage(part, 0):
        pixels = source.read_image(part, 0, 0, source.spec().nchannels, "float")
        found |= {name: pixels[::-1, :, i] for i, name in enumerate(source.spec().channelnames)}
        part += 1
    source.close()
    for layer in (Layer("Combined", "RGBA", picture, ""), *ours.layers):
        limit = tolerance(layer.name, layer.channels, depth, codec)
        for letter, plane in layer.planes():
            theirs = found[f"View.Layer.{layer.name}.{letter}"]
            np.testing.assert_allclose(theirs, plane, rtol=0, atol=limit, err_msg=layer.name)


def test_the_composite_is_written_only_where_it_is_wanted(tmp_path):
    written(tmp_path / "out.exr", "multi", "float", "zip", composite=False)
    assert "Combined" not in compositor_passes(tmp_path / "out.exr")


def test_what_half_has_no_number_for_is_clamped_and_told(tmp_path):
    path = tmp_path / "out.exr"
    values = np.array([[65504.0, 1e9, -7e4, np.inf, np.nan]], np.float32)
    bright, depth = Layer("Bright", "V", values, "x"), Layer("Depth", "Z", values, "x")
    ours = LayerSet((bright, depth), 5, 1, "ViewLayer", report={"warnings": []})
    (warning,) = write_layers(path, ours, ExrParams.checked("exr", {"depth": "half"}))
    assert warning == "layer 'Bright': 2 values are beyond 65504, the largest half: clamped"
    with OpenEXR.File(str(path), separate_channels=True) as file:
        clamped, kept = (next(iter(part.channels.values())).pixels for part in file.parts)
        assert json.loads(file.parts[0].header["strata:report"])["warnings"] == [warning]
    expected = [[LARGEST_HALF, LARGEST_HALF, -LARGEST_HALF, np.inf, np.nan]]
    np.testing.assert_array_equal(clamped.astype(np.float32), expected)
    np.testing.assert_array_equal(kept, values)


def test_a_full_disk_keeps_the_old_file_with_the_library_too(tmp_path):
    path = tmp_path / "out.exr"
    written(path, "multi", "float", "zip")
    before = path.read_bytes()
    with largest_file(2000), pytest.raises(StrataError, match=r"cannot write .*out\.exr: ."):
        written(path, "multi", "half", "dwaa")
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["out.exr"]


def test_dwaa_without_openimageio_is_refused_before_the_work(tmp_path):
    """In a process where the library cannot be found."""
    program = (
        "import sys; sys.modules['OpenImageIO'] = None; sys.modules['bpy'] = None\n"
        "from strata.addon.core.errors import StrataError\n"
        "from strata.addon.layers.exr import check_codec\n"
        "from strata.addon.layers.exr_params import ExrParams\n"
        "check_codec(ExrParams())\n"
        "try: check_codec(ExrParams.checked('exr', {'codec': 'dwaa'}))\n"
        "except StrataError as error: print(error)\n"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    (line,) = run.stdout.splitlines()
    assert line.startswith("DWAA compression needs OpenImageIO")


def test_values_reach_the_compositor(tmp_path):
    """Blender's own reader of a half DWAA file: what it computes with is what was written."""
    path = tmp_path / "out.exr"
    ours, _ = written(path, "single", "half", "dwaa")
    scene = bpy.data.scenes.new("Compositing")
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    node, output = tree.nodes.new("CompositorNodeImage"), tree.nodes.new("NodeGroupOutput")
    node.image = bpy.data.images.load(str(path))
    tree.links.new(node.outputs["Soft Shadow Key"], output.inputs[0])
    scene.compositing_node_group = tree
    settings = scene.render.image_settings
    settings.media_type, settings.file_format, settings.color_depth = "IMAGE", "OPEN_EXR", "32"
    scene.render.filepath = str(tmp_path / "composited.exr")
    bpy.ops.render.render(write_still=True, scene=scene.name)
    with OpenEXR.File(scene.render.filepath) as file:
        seen = next(iter(file.channels().values())).pixels[::-1, :, 0]
    bpy.data.scenes.remove(scene)
    np.testing.assert_allclose(seen, ours.layers[0].pixels, rtol=0, atol=2.0**-12)


def test_the_scenes_settings_reach_the_file(tmp_path):
    strata.register()
    open_blend(SAMPLES / "stacked.blend")
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.strata.backend, scene.strata.samples, scene.strata.probes = "cpu", 1, 0
    exr, scene.strata.save_to = scene.strata.exr, "FILE"
    exr.parts, exr.depth, exr.codec, exr.composite = "single", "half", "dwaa", True
    assert bpy.ops.strata.bake(filepath=str(tmp_path / "out.exr")) == {"FINISHED"}
    strata.unregister()
    with OpenEXR.File(str(tmp_path / "out.exr"), separate_channels=True) as file:
        (part,) = file.parts
        assert part.header["compression"] == OpenEXR.DWAA_COMPRESSION
        red = part.channels["ViewLayer.Combined.R"].pixels
        assert red.dtype == np.float16
        assert red.max() > 0.01
