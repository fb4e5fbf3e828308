"""What a text for an output means as a path. Nothing here asks Blender."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from pathlib import Path

from ..core.errors import StrataError

NEVER_SAVED = "Unsaved"  # what Blender takes for the name of a file that has none yet
# What bpy.path.extensions_image has beside .exr.
_IMAGE_ENDING = re.compile(
    r"\.(avif|bmp|cin|dds|dpx|hdr|j2c|jp2|jpe?g|pdd|png|psb|psd|rgba?|sgi|tga|tiff?|tx|webp)", re.IGNORECASE
)
_EXPRESSION = re.compile(r"\{\{|\}\}|\{([^{}]*)\}|[{}]")
# In the name of a file: what Blender takes out too, and what would become the frame's number.
_UNSAFE = re.compile(r'[\x00-\x1f\x7f/\\?*:|"<>#]')


def safe_name(text: str) -> str:
    """Fit for the name of a file, of any frame."""
    return _UNSAFE.sub("_", text)


def variables(text: str) -> set[str]:
    """Names that `expanded` would look up."""
    found = (match[1] for match in _EXPRESSION.finditer(text))
    return {name.partition(":")[0] for name in found if name is not None}


def resolved(text: str, folder: Path | None) -> str:
    """With `//` at its start, as Blender means it: the .blend's folder, None where it was never saved. Raises
    StrataError."""
    if not text.startswith("//"):
        return text
    if folder is None:
        raise StrataError(f"'{text}' is beside the Blender file, which was never saved")
    return os.path.join(folder, text.lstrip("/"))


def exr_path(text: str, name: str) -> str:
    """The OpenEXR that `text` means, an absolute path: in a folder (there already, or to be made where a
    slash ends it) it is called `name`; the ending of another image format gives way to .exr, as in Blender;
    any other name gets it. Raises StrataError where there is no text."""
    if not text:
        raise StrataError("no file to write to")
    root, ending = os.path.splitext(text)
    if text.endswith(("/", os.sep)) or (ending.lower() != ".exr" and os.path.isdir(text)):
        text = os.path.join(text, f"{name}.exr")
    elif _IMAGE_ENDING.fullmatch(ending):
        text = f"{root}.exr"
    elif ending.lower() != ".exr":
        text = f"{text}.exr"
    return os.path.abspath(text)


def expanded(text: str, values: Mapping[str, str | float]) -> str:
    """Blender's path templates: `{name}` becomes the value, `{name:###.##}` a number of so many digits,
    `{{` and `}}` are braces. Texts are made fit for the name of a file, but that of `blend_dir`. Raises
    StrataError for what is none of these."""

    def value_of(match: re.Match) -> str:
        if match[0] in ("{{", "}}"):
            return match[0][0]
        if match[1] is None:
            raise StrataError(f"'{text}' has a brace without its other (write two for one that stays)")
        name, colon, digits = match[1].partition(":")
        if name not in values:
            raise StrataError(f"'{text}': there is no {{{name}}}, only {', '.join(sorted(values))}")
        value = values[name]
        if colon:
            return _number(text, value, digits)
        if isinstance(value, str):
            return value if name == "blend_dir" else safe_name(value)
        return str(value)

    return _EXPRESSION.sub(value_of, text)


def _number(text: str, value: str | float, digits: str) -> str:
    whole, point, rest = digits.partition(".")
    is_form = set(whole + rest) == {"#"} and bool(point) == bool(rest)
    if isinstance(value, str) or not is_form:
        raise StrataError(f"'{text}': ':{digits}' is no form for this value")
    if point:
        return f"{value:0{len(digits) if whole else 0}.{len(rest)}f}"
    return f"{math.floor(value + 0.5):0{len(whole)}d}"
