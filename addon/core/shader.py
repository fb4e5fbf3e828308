"""A GPU program, declared: where its text is, and what it reads and writes. Knows no GPU."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

from .uniforms import Uniforms

ADDON = Path(__file__).parents[1]
SHARED = ADDON / "effects" / "shared"
LARGEST = 3.0e38
"""Stands for infinity in uniforms, where 0 times it must be 0."""

_INCLUDE = re.compile(r'^# *include "([\w./]+)"[ \t]*$', re.MULTILINE)


@dataclass(frozen=True)
class Shader:
    """A compute program, or a vertex and a fragment program where `vertex` is given.

    `source`, `vertex`: paths of *.glsl below addon/. `samplers`: (name, "FLOAT_2D" or "UINT_2D").
    `images`: (name, texture format, "READ", "WRITE" or "READ_WRITE"); `atomic_images` are R32UI and read
    and written by atomics. `params`: the uniform block `params`, as a class of Uniforms (core/uniforms.py) or
    as the names of its members, which are then vec4. `varyings`: (how, type,
    name), how being "flat" or "smooth". `outputs`: (type, name) of the fragment stage. `group`: width and
    height of a work group. Equal shaders are compiled once.
    """

    source: str
    vertex: str = ""
    defines: tuple[str, ...] = ()
    samplers: tuple[tuple[str, str], ...] = ()
    images: tuple[tuple[str, str, str], ...] = ()
    atomic_images: tuple[str, ...] = ()
    params: tuple[str, ...] | type[Uniforms] = ()
    varyings: tuple[tuple[str, str, str], ...] = ()
    outputs: tuple[tuple[str, str], ...] = ()
    writes_depth: bool = False
    group: tuple[int, int] = (8, 8)

    @property
    def name(self) -> str:
        """For messages, e.g. "effects/shared/surface.glsl +UV"."""
        return " +".join((self.source, *self.defines))

    def defining(self, *defines: str) -> Shader:
        """The same program with more `defines`, each "NAME" or "NAME value"."""
        return replace(self, defines=(*self.defines, *defines))


def shader_text(path: str) -> str:
    """The text of a file below addon/, with each #include replaced by the file it names, guarded against
    being read twice. Names are looked up beside the including file, then in effects/shared. Raises OSError
    where there is no such file, RecursionError where files include each other."""
    return _resolved(ADDON / path)


def _resolved(file: Path) -> str:
    def included(match: re.Match) -> str:
        beside = file.parent / match[1]
        target = beside if beside.exists() else SHARED / match[1]
        # One name in two folders is two files.
        guard = re.sub(r"\W", "_", f"INCLUDED_{target.parent.name}_{target.stem}".upper())
        return f"#ifndef {guard}\n#define {guard}\n{_resolved(target)}#endif"

    return _INCLUDE.sub(included, file.read_text(encoding="utf-8"))
