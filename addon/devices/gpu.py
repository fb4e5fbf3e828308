"""The GPU device: Blender's gpu module, compute and raster. Only modules gpu*.py here import it."""

from __future__ import annotations

import atexit
import time
from collections.abc import Iterable, Sequence
from threading import Event
from typing import Any, ClassVar
from weakref import WeakSet

import numpy as np

from ..core.arrays import Arrays, Placed, bytes_of
from ..core.errors import Cancelled
from ..core.outline import Outline
from ..core.placement import dimensions
from ..core.shader import Shader
from ..core.surface import Chunk
from ..core.uniforms import Uniforms
from .gpu_context import started
from .gpu_crop import cropped
from .gpu_geometry import GpuGeometry, halves
from .gpu_image import TABLE_WIDTH, GpuImage, from_texels, stack_columns, texture_format, to_texels
from .gpu_image import texture_size as size_of
from .gpu_meshes import GpuMeshes
from .gpu_shader import compiled

SPLIT_TO_INTEGER = Shader(
    "effects/shared/split_to_integer.glsl",
    samplers=(("halves", "FLOAT_2D"),),
    images=(("integers", "R32UI", "WRITE"),),
    params=("size",),
)
OFFSETS = Shader(
    "effects/shared/offsets.glsl",
    samplers=(("quantiles", "FLOAT_2D"),),
    images=(("offsets", "RG32F", "WRITE"),),
    params=("size", "seed", "dimensions"),
)
# Orders what draws stored before what comes next: the gpu module puts a barrier after dispatches only.
BARRIER = Shader("effects/shared/barrier.glsl", group=(1, 1))
SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "lavapipe", "swiftshader", "software")


class GpuDevice:
    """Runs shaders. Values are GpuImage, GpuGeometry and dicts and tuples of them.

    It works on the main thread only, which has a GPU context while it draws and in operators, though not
    always in timers. Windows have contexts of their own: textures and programs are shared between them,
    while framebuffers and batches, which are not, are made anew at each draw.
    """

    TRIANGLES_PER_DRAW = 1 << 20
    _programs: ClassVar[dict[Shader, Any]] = {}  # of all devices: a second bake compiles nothing
    name = "gpu"
    traces_rays = False
    cancelled = (Cancelled,)

    def __init__(self, cancel_flag=None):
        self.cancel_flag = cancel_flag or Event()
        self.compile_seconds = 0.0
        self._outline: Outline | None = None
        self._arrays: Arrays | None = None
        self._vertices = None  # what batches draw: so many vertices of nothing
        self._vertex_count = 0
        self._textures: dict[int, tuple[np.ndarray, GpuImage]] = {}  # by identity of the texels
        self._meshes: GpuMeshes | None = None
        self._kept: dict[str, Any] = {}
        self._offsets: tuple[Chunk, GpuImage] | None = None
        self._images: WeakSet[GpuImage] = WeakSet()
        self._gpu = started()
        _alive.add(self)
        atexit.unregister(free_all)  # once, and anew after free_all
        atexit.register(free_all)
        platform = self._gpu.platform
        self.renderer = platform.renderer_get()
        self.description = f"{self.renderer}, {platform.backend_type_get()}"
        self.is_software = any(word in self.description.lower() for word in SOFTWARE_RENDERERS)
        self.largest_texture = self._gpu.capabilities.max_texture_size_get()

    def has_context(self) -> bool:
        """Whether the GPU can be used on this thread now."""
        try:
            self._gpu.types.GPUOffScreen(1, 1).free()
        except RuntimeError:
            return False
        return True

    # The scene

    def set_scene(self, outline: Outline, arrays: Arrays) -> None:
        """The scene that `geometry` is made of from now on."""
        self._outline, self._arrays = outline, arrays
        used = {id(texels) for texels in arrays.textures.values()}
        for key in self._textures.keys() - used:
            self.release(self._textures.pop(key)[1])

    def geometry(self) -> GpuGeometry:
        """Every instance of the scene, at its index in the outline. Of meshes, only those that the last
        scene did not have (the same MeshArrays) are uploaded."""
        self._meshes = GpuMeshes.of(self, self._arrays.meshes, self._meshes)
        return GpuGeometry(self, self._outline.instances, self._arrays, self._meshes)

    def geometry_of(self, instances: Sequence[Placed], arrays: Arrays) -> GpuGeometry:
        """`instances` of the meshes of `arrays`, which are no part of the scene, say."""
        return GpuGeometry(self, instances, arrays, GpuMeshes(self, arrays.meshes))

    def texture(self, image: int) -> GpuImage | None:
        """Texels of `outline.images[image]`, uploaded when first asked for; None where they could not be
        read."""
        texels = self._arrays.textures.get(image)
        if texels is None:
            return None
        if id(texels) not in self._textures:
            self._textures[id(texels)] = texels, self.upload(np.asarray(texels, np.float32))
        return self._textures[id(texels)][1]

    # Values

    def new_image(self, shape: tuple[int, ...], dtype=np.float32) -> GpuImage:
        """An image with undefined contents. Raises ValueError where no texture is so large."""
        dtype = np.dtype(dtype)
        is_stack = len(shape) == 3 and shape[2] > 4
        columns = stack_columns(shape, self.largest_texture) if is_stack else 1
        image = GpuImage(None, tuple(shape), dtype, columns)
        image.texture = self._texture(image.size, image.format)
        self._images.add(image)
        return image

    def upload(self, array: np.ndarray) -> GpuImage:
        """A float32 or integer array as an image."""
        array = np.asarray(array)
        if array.dtype != np.float32:
            return self._upload_integers(array)
        is_stack = array.ndim == 3 and array.shape[2] > 4
        columns = stack_columns(array.shape, self.largest_texture) if is_stack else 1
        texels = to_texels(array, columns)
        channels = 1 if texels.ndim == 2 else texels.shape[2]
        size = size_of(array.shape, columns)
        texture = self._texture(size, texture_format(array.dtype, channels), texels)
        image = GpuImage(texture, array.shape, array.dtype, columns)
        self._images.add(image)
        return image

    def upload_table(self, rows: np.ndarray) -> GpuImage:
        """(N, 1 to 4) float32 as a texture that tables.glsl indexes by row number."""
        height = max(1, -(-len(rows) // TABLE_WIDTH))
        padded = np.zeros((height * TABLE_WIDTH, rows.shape[1]), np.float32)
        padded[: len(rows)] = rows
        shape = (height, TABLE_WIDTH, rows.shape[1])[: 2 if rows.shape[1] == 1 else 3]
        return self.upload(padded.reshape(shape))

    def stack_columns(self, shape: tuple[int, int, int]) -> int:
        """How many of (layers, height, width) to put side by side in a texture. Raises ValueError."""
        return stack_columns(shape, self.largest_texture)

    def clear(self, image: GpuImage, value: float) -> None:
        """Sets every component."""
        if image.format.endswith("UI"):
            # The gpu module takes signed integers only.
            signed = int(np.array(int(value) & 0xFFFFFFFF, np.uint32).astype(np.int32))
            image.texture.clear(format="UINT", value=(signed,) * image.channels)
        else:
            image.texture.clear(format="FLOAT", value=(float(value),) * 4)

    def to_host(self, value: Any) -> Any:
        if isinstance(value, GpuImage):
            return from_texels(np.asarray(value.texture.read()), value)
        return _mapped(value, self.to_host)

    def from_host(self, value: Any) -> Any:
        return self.upload(value) if isinstance(value, np.ndarray) else _mapped(value, self.from_host)

    def cropped(self, value: Any, first: tuple[int, int], shape: tuple[int, int]) -> Any:
        return cropped(self, value, first, shape)

    def size_of(self, value: Any) -> int:
        return bytes_of(value)

    def release(self, value: Any) -> None:
        if isinstance(value, GpuImage):
            value.texture = None
        elif isinstance(value, GpuGeometry):
            value.release()
        else:
            _mapped(value, self.release)

    def constant(self, name: str, make) -> Any:
        """A value made once and kept as long as the device, such as a constant table."""
        if name not in self._kept:
            self._kept[name] = make()
        return self._kept[name]

    def offsets(self, chunk: Chunk) -> GpuImage | None:
        """Device.offsets; the device keeps it until it is asked for another one's."""
        places = chunk.places
        if places is None:
            return None
        if self._offsets is None or self._offsets[0] != chunk:
            table = self.constant(
                f"quantiles {places.pixel_filter}", lambda: self.upload(places.table[None].astype(np.float32))
            )
            if self._offsets is not None:
                self.release(self._offsets[1])
            (rows, columns), image = chunk.shape, self.new_image((*chunk.shape, 2))
            params = {
                "size": (columns, rows, chunk.x0, chunk.y0),
                "seed": halves(places.seed),
                "dimensions": halves(dimensions(chunk.sample)).ravel(),
            }
            self.dispatch(OFFSETS, (columns, rows), {"offsets": image}, {"quantiles": table}, params)
            self._offsets = chunk, image
        return self._offsets[1]

    def instance_mask(self, instances: Iterable[int]) -> np.ndarray:
        """(instance count,) uint8, 1 at `instances`."""
        mask = np.zeros(len(self._outline.instances), np.uint8)
        mask[sorted(instances)] = 1
        return mask

    def free(self) -> None:
        """Lets go of everything on the GPU, also of values that others hold still."""
        self._kept.clear()
        self._offsets = None
        self._textures.clear()
        self._vertices, self._vertex_count, self._meshes = None, 0, None
        for image in self._images:
            image.texture = None

    # Work

    def dispatch(
        self,
        shader: Shader,
        size: tuple[int, int],
        images: dict[str, GpuImage],
        samplers: dict[str, GpuImage] | None = None,
        params: Uniforms | dict[str, Iterable[float]] | None = None,
    ) -> None:
        """Runs a compute shader over `size` invocations, rounded up to groups. Raises ShaderError, and
        Cancelled where the flag is set."""
        if self.cancel_flag.is_set():
            raise Cancelled()
        program, _block = self._bound(shader, images, samplers or {}, params or {})
        groups = [-(-length // side) for length, side in zip(size, shader.group, strict=True)]
        self._gpu.compute.dispatch(program, *groups, 1)

    def draw(
        self,
        shader: Shader,
        triangles: int,
        target: GpuImage,
        depth: Any,
        images: dict[str, GpuImage],
        samplers: dict[str, GpuImage],
        params: Uniforms | dict[str, Iterable[float]],
    ) -> None:
        """Draws `triangles` (at most TRIANGLES_PER_DRAW) triangles, whose vertices the shader pulls by
        gl_VertexID, into `target`; `depth` is a `new_depth` texture, or None. Raises as `dispatch`."""
        if self.cancel_flag.is_set():
            raise Cancelled()
        gpu = self._gpu
        slots = {"color_slots": [target.texture]} | ({"depth_slot": depth} if depth else {})
        batch = self._batch(3 * triangles)
        state = gpu.state
        before = state.blend_get(), state.depth_test_get(), state.depth_mask_get()
        with gpu.types.GPUFrameBuffer(**slots).bind():
            try:
                state.blend_set("NONE")
                state.face_culling_set("NONE")
                state.depth_test_set("LESS" if depth else "NONE")
                state.depth_mask_set(bool(depth))
                # Mesa's software rasterisers throw away what opaque triangles cover, and with it what those
                # fragments would have stored in images, or do nothing where no colour is written. A mask of
                # one channel out of two is neither.
                state.color_mask_set(True, not images, not images, not images)
                program, _block = self._bound(shader, images, samplers, params)
                batch.draw_range(program, elem_start=0, elem_count=3 * triangles)
            finally:
                state.blend_set(before[0])
                state.depth_test_set(before[1])
                state.depth_mask_set(before[2])
                state.color_mask_set(True, True, True, True)
        if images:
            self.dispatch(BARRIER, (1, 1), {})

    def new_depth(self, size: tuple[int, int]):
        """A depth texture, all 1, for `draw`."""
        texture = self._texture(size, "DEPTH_COMPONENT32F")
        texture.clear(format="FLOAT", value=(1.0,))
        return texture

    def finish(self) -> None:
        marker = self.constant("finish", lambda: self._texture((1, 1), "R32F"))
        frame = self._gpu.types.GPUFrameBuffer(color_slots=[marker])
        with frame.bind():
            frame.clear(color=(0.0, 0.0, 0.0, 0.0))
            frame.read_color(0, 0, 1, 1, 1, 0, "FLOAT")

    def compile(self, shader: Shader) -> Any:
        """The program, compiled at the first call. Raises ShaderError."""
        if shader not in self._programs:
            started = time.perf_counter()
            try:
                self._programs[shader] = compiled(shader)
            finally:
                self.compile_seconds += time.perf_counter() - started
        return self._programs[shader]

    def _bound(self, shader: Shader, images, samplers, params):
        """The program with everything bound, and the uniform block, which must outlive the draw."""
        program = self.compile(shader)
        program.bind()
        block = None
        if shader.params:
            if isinstance(shader.params, type):
                if type(params) is not shader.params:
                    raise TypeError(f"{shader.name} takes {shader.params.__name__}")
                values = params.packed()
            else:
                values = _rows_of(shader.params, params)
            block = self._gpu.types.GPUUniformBuf(values)
            program.uniform_block("params", block)
        for name, _kind in shader.samplers:
            program.uniform_sampler(name, samplers[name].texture)
        for name in (*(name for name, _format, _access in shader.images), *shader.atomic_images):
            program.image(name, images[name].texture)
        return program, block

    def _texture(self, size: tuple[int, int], texture_format: str, texels: np.ndarray | None = None):
        types = self._gpu.types
        if max(size) > self.largest_texture:
            raise ValueError(
                f"{size[0]} x {size[1]} texels do not fit in a texture of {self.largest_texture}"
            )
        if texels is None:
            return types.GPUTexture(size, format=texture_format)
        data = types.Buffer("FLOAT", texels.size, np.ascontiguousarray(texels).reshape(-1))
        return types.GPUTexture(size, format=texture_format, data=data)

    def _upload_integers(self, array: np.ndarray) -> GpuImage:
        """Textures are filled from floats only, so integers go in halves that floats hold exactly."""
        bits = array.astype(np.int64).astype(np.uint32)
        halves = np.stack([bits & 0xFFFF, bits >> 16], axis=-1).astype(np.float32)
        source = self.upload(halves)
        image = self.new_image(array.shape, array.dtype)
        self.dispatch(
            SPLIT_TO_INTEGER, image.size, {"integers": image}, {"halves": source}, {"size": image.size}
        )
        return image

    def _batch(self, vertices: int):
        types = self._gpu.types
        if vertices > self._vertex_count:
            count = max(vertices, min(2 * self._vertex_count, 3 * self.TRIANGLES_PER_DRAW))
            vertex_format = types.GPUVertFormat()
            vertex_format.attr_add(id="unused", comp_type="U32", len=1, fetch_mode="INT")
            self._vertices = types.GPUVertBuf(vertex_format, count)
            self._vertices.attr_fill("unused", np.zeros(count, np.uint32))
            self._vertex_count = count
        return types.GPUBatch(type="TRIS", buf=self._vertices)


_alive: WeakSet[GpuDevice] = WeakSet()


def free_all() -> None:
    """Lets go of everything on the GPU that devices hold; they make anew what they are asked for after
    it. To be called when Strata is switched off, and before Blender ends its context: what is freed later
    crashes it."""
    atexit.unregister(free_all)
    for device in _alive:
        device.free()
    GpuDevice._programs.clear()


def _rows_of(names: tuple[str, ...], params: dict[str, Iterable[float]]) -> np.ndarray:
    """(names, 4) float32."""
    values = np.zeros((len(names), 4), np.float32)
    for row, name in zip(values, names, strict=True):
        value = tuple(params[name])
        with np.errstate(over="ignore"):  # what single precision does not hold is infinite there
            row[: len(value)] = value
    return values


def _mapped(value: Any, function) -> Any:
    if isinstance(value, dict):
        return {key: function(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return type(value)(function(item) for item in value)
    return value
