"""Writes and reads the EXR files that need OpenImageIO: DWAA, whose transform nobody should write twice, and
whatever else others write.

Blender's own builds bring it for Python, the pip module without a path to it; Debian has it as
python3-openimageio.
"""

from __future__ import annotations

import importlib.util
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np

from ..core.errors import StrataError
from .openexr import Part

_NAME = "OpenImageIO"
_DWAA = "dwaa:45"  # the level that OpenEXR and Blender have by default
_ROWS = 256  # scan lines that are laid out at a time: a multiple of DWAA's blocks of 32


@cache
def library() -> ModuleType:
    """Raises StrataError where there is none."""
    try:
        return importlib.import_module(_NAME)
    except ImportError:
        pass
    try:
        import bpy

        python = Path(bpy.utils.system_resource("PYTHON"))
        (entry,) = python.glob(f"lib/python3*/site-packages/{_NAME}/__init__.py")
        spec = importlib.util.spec_from_file_location(_NAME, entry)
        module = importlib.util.module_from_spec(spec)
        sys.modules[_NAME] = module
        spec.loader.exec_module(module)
    except (ImportError, ValueError, AttributeError):
        sys.modules.pop(_NAME, None)
        raise StrataError(
            "DWAA compression needs OpenImageIO, which this Blender comes without: "
            "take ZIP, or install it (Debian: python3-openimageio)"
        ) from None
    return module


def read_planes(path: Path) -> dict[str, np.ndarray]:
    """(height, width) float32 of all parts by channel's full name, row 0 at the bottom. Raises StrataError
    where there is no library, for a file that it cannot read, and for parts that have the same channels."""
    try:
        oiio = library()
    except StrataError:
        told = "without OpenImageIO only scan lines with ZIP or without compression are read"
        raise StrataError(f"cannot read {path}: {told}") from None
    source, planes = oiio.ImageInput.open(str(path)), {}
    number = 0
    while source and source.seek_subimage(number, 0):
        names = source.spec().channelnames
        pixels = source.read_image(number, 0, 0, len(names), "float")
        if pixels is None:
            source.geterror()
            raise StrataError(f"{path} is no whole OpenEXR file")
        if twice := planes.keys() & set(names):
            raise StrataError(f"cannot read {path}: two of its parts have a channel {min(twice)}")
        planes |= {name: pixels[::-1, :, index] for index, name in enumerate(names)}
        number += 1
    if not planes:
        raise StrataError(f"cannot read {path}: {oiio.geterror() or 'OpenImageIO gives no reason'}")
    return planes


def write_parts(path: str, parts: list[Part]) -> None:
    """Writes a whole file. Raises OSError with the library's words where that fails."""
    oiio = library()
    output = oiio.ImageOutput.create("openexr")
    specs = tuple(_spec(oiio, part) for part in parts)
    _expect(output, output.open(path, specs))
    for index, (spec, part) in enumerate(zip(specs, parts, strict=True)):
        if index:
            _expect(output, output.open(path, spec, "AppendSubimage"))
        for first in range(0, part.shape[0], _ROWS):
            rows = np.stack([plane[first : first + _ROWS] for plane in part.channels.values()], axis=-1)
            top = part.offset[1] + first
            _expect(output, output.write_scanlines(top, top + len(rows), 0, rows))
    _expect(output, output.close())


def _expect(output, done: bool) -> None:
    if not done:
        raise OSError(output.geterror() or "OpenImageIO gives no reason")


def _spec(oiio: ModuleType, part: Part):
    height, width = part.shape
    spec = oiio.ImageSpec(width, height, len(part.channels), "float")
    spec.channelnames = list(part.channels)
    spec.channelformats = [oiio.TypeDesc("half" if name in part.half else "float") for name in part.channels]
    spec.x, spec.y = part.offset
    spec.full_width, spec.full_height = part.frame_size or (width, height)
    if part.name:
        spec.attribute("oiio:subimagename", part.name)
        spec.attribute("name", part.name)
    spec.attribute("compression", _DWAA)
    spec.attribute("PixelAspectRatio", part.pixel_aspect)
    for name, value in part.attributes.items():
        spec.attribute(name, value)
    return spec
