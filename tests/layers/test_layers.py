"""Layers on their way out: EXR files, Blender's compositor, Blender's images, the contact sheet."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import OpenEXR
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.core.layers import Layer, LayerSet
from strata.addon.core.naming import LONGEST, lamp_pass_name, layer_name
from strata.addon.layers.exr import write_layers
from strata.addon.layers.exr_params import ExrParams
from strata.addon.layers.files import check_writable, replaced
from strata.tests.layers.made_layers import (
    ERROR,
    HEIGHT,
    WIDTH,
    compositor_passes,
    largest_file,
    layer,
    layer_set,
    pixels,
)
from strata.tests.support.exr_layers import read_layers


def exr(**values) -> ExrParams:
    return ExrParams.checked("exr", values)


def odd_light_names() -> list[str]:
    long = "Straßenlaterne mit einem sehr langen Namen über der alten Brücke am Fluß, Nummer 10000"
    return ["Key.001", "灯" * 100, long + "1", long + "2", "tab\there", "a/b:c", "-"]


def test_every_value_and_figure_comes_back(tmp_path):
    path = tmp_path / "out.exr"
    written = layer_set(
        layer("Soft Shadow Key", light="Key", seed=1),
        layer("Glow", "RGBA", seed=2),
        layer("Normal", "XYZ", seed=3),
        space="ACEScg",
    )
    write_layers(path, written)
    back = read_layers(path)
    assert (back.width, back.height, back.view_layer) == (WIDTH, HEIGHT, "ViewLayer")
    assert (back.working_space, back.pixel_aspect, back.report) == ("ACEScg", 2.0, written.report)
    for ours, theirs in zip(written.layers, back.layers, strict=True):
        np.testing.assert_array_equal(ours.pixels, theirs.pixels)
        for name in ("name", "channels", "effect", "light", "seconds", "error", "settings"):
            assert getattr(ours, name) == getattr(theirs, name), name


def test_file_says_what_openexr_readers_expect(tmp_path):
    path = tmp_path / "out.exr"
    ours = layer_set(layer("Soft Shadow Key", light="Key"), layer("Glow", "RGBA"))
    write_layers(path, ours)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        shadow, glow = file.parts
        assert shadow.name() == "ViewLayer.Soft Shadow Key"
        assert list(shadow.channels) == ["ViewLayer.Soft Shadow Key.V"]
        assert sorted(glow.channels) == [f"ViewLayer.Glow.{letter}" for letter in "ABGR"]
        top_row = shadow.channels["ViewLayer.Soft Shadow Key.V"].pixels[0]
        np.testing.assert_array_equal(top_row, ours.layers[0].pixels[-1])
        assert top_row.dtype == np.float32
        assert shadow.header["colorInteropID"] == "data"
        assert glow.header["colorInteropID"] == "lin_rec709_scene"
        assert shadow.header["compression"] == OpenEXR.ZIP_COMPRESSION
        assert shadow.header["strata:light"] == "Key"
        assert shadow.header["strata:weight"] == "none"
        assert json.loads(shadow.header["strata:error"]) == ERROR
        assert json.loads(shadow.header["strata:report"])["frame"] == 3
        assert "strata:report" not in glow.header


@pytest.mark.parametrize("view_layer", ["ViewLayer", "View.Layer.001", "View-", "灯 layer"])
def test_compositor_lists_every_pass(tmp_path, view_layer):
    path = tmp_path / "out.exr"
    names = ["Soft Shadow Key", "Soft Shadow Fill Light", "Glow"]
    layers = [layer(names[0]), layer(names[1]), layer(names[2], "RGBA")]
    write_layers(path, layer_set(*layers, view_layer=view_layer))
    assert compositor_passes(path) == set(names)


def test_odd_light_names_stay_apart_and_survive(tmp_path):
    path, names, layers = tmp_path / "out.exr", [], []
    for seed, light in enumerate(odd_light_names()):
        names.append(layer_name("Soft Shadow", lamp_pass_name(light, light)))
        layers.append(layer(names[-1], light=light, seed=seed))
    assert len(set(names)) == len(names)
    assert all(len(name.encode()) <= LONGEST and "." not in name for name in names)
    write_layers(path, layer_set(*layers))
    back = read_layers(path)
    assert [theirs.light for theirs in back.layers] == odd_light_names()
    for ours, theirs in zip(layers, back.layers, strict=True):
        np.testing.assert_array_equal(ours.pixels, theirs.pixels)
    assert compositor_passes(path) == set(names)


def test_bad_pixels_are_refused_early():
    with pytest.raises(ValueError, match="not float32 RGB"):
        Layer("Glow", "RGB", pixels("RGBA"), "glow")
    with pytest.raises(ValueError, match="not float32 V"):
        Layer("Mask", "V", np.zeros((HEIGHT, WIDTH)), "mask")
    with pytest.raises(ValueError, match="is not 8 x 5"):
        LayerSet((layer("Glow"),), WIDTH + 1, HEIGHT, "ViewLayer")


def test_full_disk_keeps_the_old_file_and_leaves_nothing(tmp_path):
    path = tmp_path / "out.exr"
    write_layers(path, layer_set(layer("Old")))
    with largest_file(500), pytest.raises(StrataError, match=r"cannot write .*out\.exr: File too large"):
        write_layers(path, layer_set(layer("New")))
    assert read_layers(path).layers[0].name == "Old"
    assert os.listdir(tmp_path) == ["out.exr"]


def test_no_space_left_is_told_in_one_line(tmp_path):
    full_disk = pytest.raises(StrataError, match="No space left on device")
    with full_disk as caught, replaced(tmp_path / "out.exr"), open("/dev/full", "wb", buffering=0) as full:
        full.write(b"x")
    assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == []


def test_interrupt_leaves_nothing(tmp_path):
    def interrupted():
        with replaced(tmp_path / "out.exr") as stream:
            stream.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert os.listdir(tmp_path) == []


def test_hopeless_targets_are_refused_before_the_work(tmp_path):
    (tmp_path / "folder.exr").mkdir()
    for path, reason in (
        (tmp_path / "folder.exr", "is a folder"),
        ("/dev/null", "not a regular file"),
    ):
        with pytest.raises(StrataError, match=reason):
            check_writable(path)


def test_folder_without_write_permission_is_refused(tmp_path):
    """In a process of its own, since root has to give up its power for good to be refused anything."""
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o555)
    tmp_path.chmod(0o755)
    program = (
        "import os, sys; os.chdir('/')\n"
        "from strata.addon.core.errors import StrataError\n"
        "from strata.addon.layers.files import check_writable\n"
        "os.geteuid() == 0 and os.setuid(65534)\n"
        "try: check_writable(sys.argv[1])\n"
        "except StrataError as error: print(error)\n"
    )
    for parent in folder.parents:  # pytest's folders are private to their owner
        if parent.stat().st_uid == os.geteuid() and str(parent).startswith("/tmp/"):
            parent.chmod(0o755)
    run = [sys.executable, "-c", program, str(folder / "out.exr")]
    assert "is not writable" in subprocess.run(run, capture_output=True, text=True, check=True).stdout


def test_a_symbolic_link_keeps_pointing(tmp_path):
    target, link = tmp_path / "real.exr", tmp_path / "link.exr"
    target.write_bytes(b"old")
    link.symlink_to(target)
    write_layers(link, layer_set(layer("New")))
    assert link.is_symlink()
    assert read_layers(target).layers[0].name == "New"


@pytest.mark.parametrize("height", [1, 15, 16, 17, 33])
@pytest.mark.parametrize("count", [1, 2])
def test_every_block_of_rows_comes_back(tmp_path, height, count):
    """Blocks are 16 rows; the last may be shorter. Noise does not deflate, so it is stored as it is."""
    noise = np.random.default_rng(height).integers(0, 1 << 32, (height, 3, 4), np.uint32).view(np.float32)
    noise[~np.isfinite(noise)] = 0.0  # the comparison below would not find a NaN equal
    flat = np.full((height, 3), 0.5, np.float32)
    layers = (Layer("Noise", "RGBA", noise, "x"), Layer("Flat", "V", flat, "x"))[:count]
    write_layers(tmp_path / "out.exr", LayerSet(layers, 3, height, "ViewLayer"))
    back = read_layers(tmp_path / "out.exr")
    for ours, theirs in zip(layers, back.layers, strict=True):
        np.testing.assert_array_equal(ours.pixels.view(np.uint32), theirs.pixels.view(np.uint32))


def test_non_finite_values_survive(tmp_path):
    values = np.array([[np.nan, np.inf, -np.inf, -0.0]], np.float32)
    write_layers(tmp_path / "out.exr", LayerSet((Layer("Bad", "V", values, "x"),), 4, 1, "ViewLayer"))
    back = read_layers(tmp_path / "out.exr").layers[0].pixels
    np.testing.assert_array_equal(values.view(np.uint32), back.view(np.uint32))


@pytest.mark.parametrize("codec", ["zip", "dwaa"])
def test_a_render_region_can_be_the_data_window(tmp_path, codec):
    path, region = tmp_path / "out.exr", (1, 1, 4, 3)  # from the bottom left
    shadow, glow = layer("Soft Shadow Key"), layer("Normal", "XYZ")
    ours = replace(layer_set(shadow, glow), region=region)
    write_layers(path, ours, exr(window="region", codec=codec))
    with OpenEXR.File(str(path), separate_channels=True) as file:
        for part, ours in zip(file.parts, (shadow, glow), strict=True):
            assert [corner.tolist() for corner in part.header["displayWindow"]] == [[0, 0], [6, 4]]
            assert [corner.tolist() for corner in part.header["dataWindow"]] == [[1, 2], [3, 3]]
            for name, channel in part.channels.items():
                plane = dict(ours.planes())[name[-1]]
                np.testing.assert_array_equal(channel.pixels[::-1], plane[1:3, 1:4])


def test_else_a_render_region_is_a_whole_frame(tmp_path):
    path, ours = tmp_path / "out.exr", replace(layer_set(layer("Glow")), region=(1, 1, 4, 3))
    write_layers(path, ours)
    np.testing.assert_array_equal(read_layers(path).layers[0].pixels, ours.layers[0].pixels)


def test_a_cropped_picture_tells_where_it_was_cut_from(tmp_path):
    path = tmp_path / "out.exr"
    cropped = replace(layer_set(layer("Glow")), region=(3, 10, 3 + WIDTH, 10 + HEIGHT), frame_size=(32, 18))
    write_layers(path, cropped)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header = dict(file.parts[0].header)
    for window in ("displayWindow", "dataWindow"):  # as Blender crops
        assert [corner.tolist() for corner in header[window]] == [[0, 0], [WIDTH - 1, HEIGHT - 1]]
    # 18 rows, of which 3 are above it and 10 below.
    assert json.loads(header["strata:cropped_from"]) == {"frame": [32, 18], "offset": [3, 3]}
    write_layers(path, cropped, exr(window="region"))
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header = dict(file.parts[0].header)
    assert [corner.tolist() for corner in header["displayWindow"]] == [[0, 0], [31, 17]]
    assert [corner.tolist() for corner in header["dataWindow"]] == [[3, 3], [2 + WIDTH, 2 + HEIGHT]]


@pytest.mark.parametrize("height", [1, 16, 17, 33, 48])
def test_a_layer_of_one_value_comes_back(tmp_path, height):
    one = np.broadcast_to(np.float32(1.0), (height, 3))
    grey = np.broadcast_to(np.float32(0.25), (height, 3, 3))
    layers = (Layer("One", "V", one, "x"), Layer("Grey", "RGB", grey, "x", view_layer="Other"))
    write_layers(tmp_path / "out.exr", LayerSet(layers, 3, height, "ViewLayer"))
    for ours, theirs in zip(layers, read_layers(tmp_path / "out.exr").layers, strict=True):
        np.testing.assert_array_equal(ours.pixels, theirs.pixels)
    with OpenEXR.File(str(tmp_path / "out.exr")) as file:
        assert [part.name() for part in file.parts] == ["ViewLayer.One", "Other.Grey"]


def test_folders_are_made_and_taken_away_where_writing_fails(tmp_path):
    with replaced(tmp_path / "a" / "b" / "x.bin") as stream:
        stream.write(b"x")
    assert (tmp_path / "a" / "b" / "x.bin").read_bytes() == b"x"
    with pytest.raises(KeyboardInterrupt), replaced(tmp_path / "a" / "c" / "d" / "x.bin"):
        raise KeyboardInterrupt
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["b"]
    with pytest.raises(StrataError, match="is not a folder"):
        check_writable(tmp_path / "a" / "b" / "x.bin" / "y.bin")
