"""Plain OpenEXR files, as the library writes them."""

from __future__ import annotations

import numpy as np
import OpenEXR
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.layers.exr_pixels import read_plain


def written(path, parts: int, compression=OpenEXR.NO_COMPRESSION, dtype=np.float32) -> dict:
    rng = np.random.default_rng(1)
    planes = {f"Layer {n}.Pass.{c}": rng.random((7, 5)).astype(dtype) for n in range(parts) for c in "BGR"}
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    names = list(planes)
    made = [
        OpenEXR.Part(dict(header), {name: planes[name] for name in names[3 * n : 3 * n + 3]}, f"part {n}")
        for n in range(parts)
    ]
    OpenEXR.File(made).write(str(path))
    return planes


@pytest.mark.parametrize("parts", [1, 3])
def test_pixels_are_those_that_the_library_wrote(tmp_path, parts):
    path = tmp_path / "plain.exr"
    planes = written(path, parts)
    found = read_plain(path)
    assert found.keys() == planes.keys()
    for name, plane in planes.items():
        assert np.array_equal(found[name], plane[::-1])


@pytest.mark.parametrize("how", [{"compression": OpenEXR.ZIP_COMPRESSION}, {"dtype": np.float16}])
def test_others_are_refused_in_one_line(tmp_path, how):
    path = tmp_path / "other.exr"
    written(path, 1, **how)
    with pytest.raises(StrataError, match="not the plain OpenEXR file"):
        read_plain(path)


def test_what_is_cut_off_is_refused(tmp_path):
    path = tmp_path / "cut.exr"
    written(path, 1)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(StrataError, match="not the plain OpenEXR file"):
        read_plain(path)
