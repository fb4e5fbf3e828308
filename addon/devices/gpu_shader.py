"""Compiling: the only place where a declared Shader becomes a program of Blender's gpu module."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..core.errors import ShaderError
from ..core.shader import Shader, shader_text


@contextmanager
def captured_output() -> Iterator[list[str]]:
    """What anything, native code too, writes to file descriptors 1 and 2 meanwhile; the list holds it at the
    end. Blender logs compiler messages on either, depending on its version."""
    found: list[str] = []
    sys.stdout.flush()
    sys.stderr.flush()
    with tempfile.TemporaryFile() as file:
        saved = [os.dup(descriptor) for descriptor in (1, 2)]
        for descriptor in (1, 2):
            os.dup2(file.fileno(), descriptor)
        try:
            yield found
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            for descriptor, copy in zip((1, 2), saved, strict=True):
                os.dup2(copy, descriptor)
                os.close(copy)
            file.seek(0)
            found.append(file.read().decode(errors="replace"))


def compiled(shader: Shader):
    """A gpu.types.GPUShader. Raises ShaderError with the compiler's log."""
    import gpu

    texts = [shader_text(path) for path in (shader.vertex, shader.source) if path]
    failure = None
    with captured_output() as said:
        try:
            program = gpu.shader.create_from_info(_create_info(gpu.types, shader, texts))
        except Exception as error:  # the gpu module raises a bare Exception
            failure = error
    if failure is not None:
        raise ShaderError(shader.name, said[0] or str(failure)) from None
    if said[0]:
        sys.stderr.write(said[0])
    return program


def _create_info(types, shader: Shader, texts: list[str]):
    info = types.GPUShaderCreateInfo()
    for define in shader.defines:
        info.define(*define.split(" ", 1))
    if shader.params:
        named = isinstance(shader.params, tuple)
        members = " ".join(f"vec4 {name};" for name in shader.params) if named else shader.params.glsl()
        info.typedef_source(f"struct Params {{ {members} }};\n")
        info.uniform_buf(0, "Params", "params")
    for slot, (name, kind) in enumerate(shader.samplers):
        info.sampler(slot, kind, name)
    for slot, (name, texture_format, access) in enumerate(shader.images):
        kind = "UINT_2D" if texture_format.endswith("UI") else "FLOAT_2D"
        info.image(slot, texture_format, kind, name, qualifiers=set(access.split("_")))
    for slot, name in enumerate(shader.atomic_images, start=len(shader.images)):
        info.image(slot, "R32UI", "UINT_2D_ATOMIC", name, qualifiers={"READ", "WRITE"})
    if not shader.vertex:
        info.local_group_size(*shader.group, 1)
        info.compute_source(texts[0])
        return info
    # Blender draws no batch without an attribute; vertices are pulled from tables, so this one holds nothing.
    info.vertex_in(0, "UINT", "unused")
    if shader.varyings:
        interface = types.GPUStageInterfaceInfo(Path(shader.vertex).stem + "_varyings")
        for how, kind, name in shader.varyings:
            getattr(interface, how)(kind, name)
        info.vertex_out(interface)
    for slot, (kind, name) in enumerate(shader.outputs):
        info.fragment_out(slot, kind, name)
    if shader.writes_depth:
        info.depth_write("ANY")
    info.vertex_source(texts[0])
    info.fragment_source(texts[1])
    return info
