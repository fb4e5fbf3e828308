"""Puts a picture into a viewport: the only drawing of the preview."""

from __future__ import annotations

from typing import Any

import gpu
import numpy as np

from ..core.shader import Shader
from ..devices.gpu_shader import compiled
from .view_transform import LOWEST, SIZE, STEPS

COLOUR = Shader(
    "preview/display.glsl",
    vertex="preview/quad.glsl",
    samplers=(("image", "FLOAT_2D"), ("table", "FLOAT_3D")),
    params=("place", "levels", "style"),
    varyings=(("smooth", "VEC2", "at"),),
    outputs=(("VEC4", "colour"),),
)
DATA = Shader(
    "preview/display.glsl",
    vertex="preview/quad.glsl",
    defines=("DATA",),
    samplers=(("image", "FLOAT_2D"),),
    params=("place", "levels", "style"),
    varyings=(("smooth", "VEC2", "at"),),
    outputs=(("VEC4", "colour"),),
)
GREY = DATA.defining("GREY")
SHOWN = DATA.defining("SHOWN")

_programs: dict[Shader, Any] = {}
_quad: list[Any] = []


def variants() -> tuple[Shader, ...]:
    """Every program that the preview may compile."""
    return COLOUR, DATA, GREY, SHOWN


def release() -> None:
    """Lets go of everything on the GPU."""
    _programs.clear()
    _quad.clear()


def picture_texture(pixels: np.ndarray):
    """A texture of (height, width[, 3 or 4]) float32; three channels are opaque."""
    height, width = pixels.shape[:2]
    if pixels.shape[2:] == (3,):
        pixels = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=2)
    data = gpu.types.Buffer("FLOAT", pixels.size, np.ascontiguousarray(pixels).reshape(-1))
    return gpu.types.GPUTexture((width, height), format="R32F" if pixels.ndim == 2 else "RGBA32F", data=data)


def table_texture(table: np.ndarray):
    """The texture of a view transform's table."""
    data = gpu.types.Buffer("FLOAT", table.size, np.ascontiguousarray(table).reshape(-1))
    return gpu.types.GPUTexture((SIZE, SIZE, SIZE), format="RGBA16F", data=data)


def shown_texture(image, is_grey: bool, table=None, exposure_factor: float = 1.0):
    """What a texture `image`, of one channel or of four, looks like, as a texture of the same size: made
    once, as a window is redrawn many times, and has up to 64 times the pixels of a coarse picture. `table` is
    a view transform's texture, None to show numbers as they are."""
    shader = GREY if is_grey else DATA if table is None else COLOUR
    values = np.zeros((len(shader.params), 4), np.float32)
    values[0] = -1.0, -1.0, 1.0, 1.0
    values[1, :3] = LOWEST, STEPS, SIZE
    values[2, 0] = exposure_factor
    shown = gpu.types.GPUTexture((image.width, image.height), format="RGBA16F")
    # Not kept: a framebuffer belongs to one window's context.
    with gpu.types.GPUFrameBuffer(color_slots=shown).bind():
        _draw(shader, values, "NONE", True, image=image, **({"table": table} if shader is COLOUR else {}))
    return shown


def draw_picture(
    shown, place: tuple[float, float, float, float], size: tuple[int, int], is_overlay: bool = False
) -> None:
    """Draws a texture of four channels into the bound framebuffer. `place` is left, bottom, right, top in
    pixels of a viewport of `size` pixels; `is_overlay`: the framebuffer is that of its overlays, so that the
    texture holds what the display is sent. Blends by alpha, premultiplied; all state is put back."""
    values = np.zeros((len(SHOWN.params), 4), np.float32)
    values[0] = [2.0 * edge / size[i % 2] - 1.0 for i, edge in enumerate(place)]
    values[2, 1] = is_overlay
    # A camera's frame begins anywhere within a pixel; a picture of a pixel for each of its own stays sharp.
    coarse = abs(place[2] - place[0] - shown.width) >= 1.0 or abs(place[3] - place[1] - shown.height) >= 1.0
    _draw(SHOWN, values, "ALPHA_PREMULT", coarse, image=shown)


def _draw(shader: Shader, values: np.ndarray, blend: str, interpolates: bool, **textures) -> None:
    """Two triangles; `values` are the shader's parameters; `interpolates` between texels."""
    if shader not in _programs:
        _programs[shader] = compiled(shader)
    if not _quad:
        form = gpu.types.GPUVertFormat()
        form.attr_add(id="unused", comp_type="U32", len=1, fetch_mode="INT")
        _quad.append(gpu.types.GPUVertBuf(form, 6))
        _quad[0].attr_fill("unused", np.zeros(6, np.uint32))
    program, batch = _programs[shader], gpu.types.GPUBatch(type="TRIS", buf=_quad[0])
    state = gpu.state
    before = state.blend_get(), state.depth_test_get(), state.depth_mask_get()
    try:
        state.blend_set(blend)
        state.depth_test_set("NONE")
        state.depth_mask_set(False)
        program.bind()
        block = gpu.types.GPUUniformBuf(values)
        program.uniform_block("params", block)
        for name, texture in textures.items():
            texture.filter_mode(interpolates)
            texture.extend_mode("EXTEND")
            program.uniform_sampler(name, texture)
        batch.draw(program)
    finally:
        state.blend_set(before[0])
        state.depth_test_set(before[1])
        state.depth_mask_set(before[2])
