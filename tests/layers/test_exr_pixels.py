"""Pixels of OpenEXR files, as the library writes them."""

from __future__ import annotations

import numpy as np
import OpenEXR
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.layers import openimageio
from strata.addon.layers.exr_pixels import read_pixels


def written(path, parts: int, compression=OpenEXR.NO_COMPRESSION, dtype=np.float32) -> dict:
    rng = np.random.default_rng(1)
    planes = {
        f"Layer {n}.Pass.{c}": rng.random((37, 50)).round(2).astype(dtype)
        for n in range(parts)
        for c in "BGR"
    }
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    names = list(planes)
    made = [
        OpenEXR.Part(dict(header), {name: planes[name] for name in names[3 * n : 3 * n + 3]}, f"part {n}")
        for n in range(parts)
    ]
    OpenEXR.File(made).write(str(path))
    return planes


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize(
    "compression", [OpenEXR.NO_COMPRESSION, OpenEXR.ZIPS_COMPRESSION, OpenEXR.ZIP_COMPRESSION]
)
@pytest.mark.parametrize("dtype", [np.float32, np.float16])
def test_pixels_are_those_that_the_library_wrote(tmp_path, parts, compression, dtype):
    path = tmp_path / "plain.exr"
    planes = written(path, parts, compression, dtype)
    found = read_pixels(path)
    assert found.keys() == planes.keys()
    for name, plane in planes.items():
        assert np.array_equal(found[name], plane[::-1])


@pytest.mark.parametrize("parts", [1, 3])
def test_others_are_read_by_another_library(tmp_path, parts):
    plain, other = tmp_path / "plain.exr", tmp_path / "other.exr"
    written(plain, parts)
    written(other, parts, OpenEXR.PIZ_COMPRESSION)
    expected, found = read_pixels(plain), read_pixels(other)
    assert expected.keys() == found.keys()
    for name, plane in expected.items():
        np.testing.assert_array_equal(found[name], plane)


def test_others_are_refused_in_one_line_without_it(tmp_path, monkeypatch):
    path = tmp_path / "other.exr"
    written(path, 1, OpenEXR.PIZ_COMPRESSION)

    def none() -> None:
        raise StrataError("there is none")

    monkeypatch.setattr(openimageio, "library", none)
    with pytest.raises(StrataError, match="only scan lines with ZIP or without compression"):
        read_pixels(path)


def test_others_that_are_cut_off_are_refused(tmp_path):
    path = tmp_path / "cut.exr"
    written(path, 1, OpenEXR.PIZ_COMPRESSION)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(StrataError, match=r"no whole OpenEXR file|cannot read"):
        read_pixels(path)


def test_what_is_cut_off_is_refused(tmp_path):
    path = tmp_path / "cut.exr"
    written(path, 1)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(StrataError, match="no whole OpenEXR file"):
        read_pixels(path)
