"""How an EXR is written: declared once, for the scene's properties, the panel and the command line."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from ..core.params import Params, param


class Parts(Enum):
    MULTI = "multi"
    SINGLE = "single"


class Depth(Enum):
    FLOAT = "float"
    HALF = "half"


class Codec(Enum):
    ZIP = "zip"
    DWAA = "dwaa"


class Window(Enum):
    FRAME = "frame"
    REGION = "region"


@dataclass(frozen=True)
class ExrParams(Params):
    parts: Parts = param(
        Parts.MULTI,
        words={"multi": "Per Layer", "single": "One for All"},
        doc="A part for each layer, which readers load one at a time, or all layers in one part",
    )
    depth: Depth = param(
        Depth.FLOAT,
        words={"float": "32 Bit", "half": "16 Bit"},
        doc="Bits of a number: 32, or 16 for colours and masks (depths and ids stay at 32)",
    )
    codec: Codec = param(
        Codec.ZIP,
        words={"zip": "ZIP (lossless)", "dwaa": "DWAA (lossy)"},
        doc="Compression: lossless, or lossy for colours (dwaa, needs OpenImageIO)",
    )
    window: Window = param(
        Window.FRAME,
        doc="With a render region: the picture as Blender has it, neutral outside, or a data window of the "
        "region in the frame (Blender 5.2's own compositor puts those in a wrong place)",
    )
    composite: bool = param(False, doc="Also write the picture of all lights with all layers joined, first")
