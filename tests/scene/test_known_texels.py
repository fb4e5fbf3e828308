"""Pictures are evaluated again where what they are made of has changed, and nowhere else."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from strata.addon.scene.known_texels import KnownTexels
from strata.addon.scene.nodes.pictures import Picture, Placement
from strata.addon.scene.nodes.textures import Texture
from strata.addon.scene.nodes.values import COLOUR, FLOAT, VECTOR, Uv, apply, converted, looked_up, variable

SIZE = 4


@pytest.fixture
def image():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.data.images.new("Image", SIZE, SIZE, alpha=True)


def paint(image: bpy.types.Image, red: float) -> None:
    """Its first texel; Blender tells nobody."""
    pixels = np.array(image.pixels[:], np.float32)
    pixels[0] = red
    image.pixels.foreach_set(pixels)


def colour_of(image: bpy.types.Image, extension: str = "REPEAT") -> Picture:
    """As a scan makes it, anew each time."""
    texture = Texture(image, image.name_full, extension, "Linear", True)
    texel = looked_up(texture, variable(VECTOR, Uv()))
    return Picture(apply("colour", COLOUR, lambda t: t[..., :3], texel), Placement())


def darkened(image: bpy.types.Image) -> Picture:
    half = apply("half", FLOAT, lambda v: 0.5 * v, converted(colour_of(image).value, FLOAT))
    return Picture(half, Placement())


def test_texels_are_kept_until_a_pixel_is_other(image):
    paint(image, 0.2)
    known = KnownTexels()
    first, plain = (known.read({0: darkened(image), 1: colour_of(image)})[index][0] for index in (0, 1))
    again = known.read({5: darkened(image), 7: colour_of(image)})
    assert again[5][0] is first
    assert again[7][0] is plain
    paint(image, 0.9)
    other = known.read({0: darkened(image)})[0][0]
    assert other[0, 0] > first[0, 0]
    assert np.array_equal(other.ravel()[1:], first.ravel()[1:])


@pytest.mark.parametrize(
    "edit",
    [
        lambda image: setattr(image.colorspace_settings, "name", "Non-Color"),
        lambda image: setattr(image, "alpha_mode", "PREMUL"),
        lambda image: image.scale(2 * SIZE, SIZE),
    ],
)
def test_how_an_image_is_read_counts(image, edit):
    known = KnownTexels()
    first = known.read({0: colour_of(image)})[0][0]
    edit(image)
    assert known.read({0: colour_of(image)})[0][0] is not first


def test_what_nothing_uses_is_forgotten(image):
    known = KnownTexels()
    first = known.read({0: darkened(image)})[0][0]
    assert known.read({}) == {}
    assert known.read({0: darkened(image)})[0][0] is not first


def test_tiles_are_kept_until_their_file_is_other(tmp_path):
    bpy.ops.wm.read_factory_settings(use_empty=True)

    def save(red: float) -> None:
        tile = bpy.data.images.new("tile", SIZE, SIZE)
        paint(tile, red)
        tile.filepath_raw, tile.file_format = str(tmp_path / "tile.1001.png"), "PNG"
        tile.save()
        bpy.data.images.remove(tile)

    save(0.2)
    image = bpy.data.images.load(str(tmp_path / "tile.1001.png"))
    image.source, image.filepath = "TILED", str(tmp_path / "tile.<UDIM>.png")
    known = KnownTexels()
    first = known.read({0: darkened(image)})[0][0]
    assert known.read({0: darkened(image)})[0][0] is first
    save(0.9)
    assert known.read({0: darkened(image)})[0][0][0, 0] > first[0, 0]
