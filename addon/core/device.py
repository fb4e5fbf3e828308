"""What the executor and steps ask of a device, and what a reference asks of rays.

`Device` is what both have; `CpuSteps` and `GpuSteps` are all that the twins of steps call beside it. A test
reads what the twins call and compares, and what the devices have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

import numpy as np

from .arrays import Arrays, OpacityArrays, Placed
from .outline import Outline
from .shader import Shader
from .surface import Chunk
from .uniforms import Uniforms
from .view import Vector, View
from .view_rays import ViewRays


class Device(Protocol):
    """Runs steps. Values (arrays, images, handles) belong to the device that made them.

    `cancel_flag` has `set()` and `is_set()`. Constructing one raises DeviceUnavailable where it cannot work.
    """

    name: str  # "cpu" or "gpu"
    traces_rays: bool  # rays live on one device; for others' steps they cost a way there and back
    description: str
    cancel_flag: Any
    compile_seconds: float
    cancelled: tuple[type[Exception], ...]  # what a twin raises when the flag is set

    def set_scene(self, outline: Outline, arrays: Arrays) -> None:
        """The scene that all that follows is asked of from now on."""

    def geometry(self) -> Any:
        """A handle of every instance of the scene, at its index in the outline."""

    def geometry_of(self, instances: Sequence[Placed], arrays: Arrays) -> Any:
        """The same of `instances` of the meshes of `arrays`, which are no part of the scene, say."""

    def instance_mask(self, instances: Iterable[int]) -> np.ndarray:
        """(instance count,) uint8 on the host, 1 at `instances`."""

    def texture(self, image: int) -> Any:
        """Texels (h, w, 4) of `outline.images[image]` as a value, None where they could not be read."""

    def offsets(self, chunk: Chunk) -> Any:
        """Where each of its pixels is sampled, (rows, columns, 2) float32 pixels from its centre as a value;
        None where all share their jitter."""

    def to_host(self, value: Any) -> Any:
        """The same value made of numpy arrays (dicts, tuples and lists keep their shape)."""

    def from_host(self, value: Any) -> Any:
        """The inverse of `to_host`."""

    def cropped(self, value: Any, first: tuple[int, int], shape: tuple[int, int]) -> Any:
        """Of the value's images (rows, columns[, channels]) `shape` rows and columns, from row and column
        `first` on."""

    def size_of(self, value: Any) -> int:
        """Bytes that the value's arrays take; 0 for handles that do not tell."""

    def finish(self) -> None:
        """Waits until all work is done, so that a clock read next is honest."""

    def release(self, value: Any) -> None:
        """Frees what the value holds on the device."""


class CpuSteps(Device, Protocol):
    """What twins on the CPU call. `kernels` is the native module; a geometry is its handle."""

    kernels: Any

    def laid_out(self, geometry: Any, instances: frozenset[int]) -> Any:
        """The triangles of these instances where their UV maps put them, for `chart`."""

    def chart(
        self, laid_out: Any, origin: Vector, chunk: Chunk, attributes: frozenset[str]
    ) -> dict[str, np.ndarray]:
        """Their shading points at the chunk's texels (core/surface.py), positions relative to `origin`."""

    def vertex_values(self, name: str) -> list[tuple[int, np.ndarray]]:
        """Meshes whose vertices have values of that name, which the graph asked for: index and (V,)
        float32."""

    def unless_cancelled[Result](self, work: Callable[[], Result]) -> Result:
        """What `work()` returns, for kernels that cannot stop in the middle. Raises one of `cancelled` where
        the flag is set meanwhile."""


class GpuImage(Protocol):
    """An array on the GPU, of this `shape` and `dtype`: (height, width), (height, width, 2 to 4) or (layers,
    height, width), whose layers lie side by side, `columns` of them in a row. `size`: width and height of its
    texture."""

    shape: tuple[int, ...]
    dtype: np.dtype
    columns: int

    @property
    def size(self) -> tuple[int, int]: ...


class GpuGeometry(Protocol):
    """Instances on the GPU: tables that shaders pull vertices from, and what to draw of them."""

    @property
    def instance_count(self) -> int: ...

    @property
    def positions(self) -> GpuImage:
        """A row a vertex: relative to its mesh's middle, in object space."""

    @property
    def triangles(self) -> GpuImage:
        """A row a triangle: its vertices, counted in its mesh, and its number in its mesh."""

    @property
    def corner_normals(self) -> GpuImage:
        """Three rows a triangle, unit, in object space; zero for a flat mesh."""

    @property
    def corner_uvs(self) -> GpuImage:
        """Three rows a triangle; zero where the mesh has none."""

    @property
    def corner_opacity(self) -> GpuImage:
        """Three rows a triangle, what opacities by corner are multiplied by."""

    @property
    def corner_colours(self) -> GpuImage:
        """Three rows a triangle, what colours by corner are multiplied by."""

    def opacities(self, material: int, use: str) -> list[tuple[GpuImage, OpacityArrays]]:
        """Texels of a material's front and back, that are "seen" or that "casts", and what is said of
        them."""

    def draw_list(self, instances: frozenset[int], use: str, kept: str) -> Any:
        """`runs`, `blocks` (tables) and `ranges` of triangles to draw, each with one material whose opacity
        is to be looked up or none, and `use`: "seen" or "casts"; `kept`: as layered depth has it."""

    def depth_bounds(self, view: View, instances: frozenset[int]) -> tuple[float, float]:
        """Smallest and largest depth of the instances' boxes, metres along the view's forward axis."""

    def clip_matrices(
        self,
        view: View,
        rows: tuple[int, int],
        size,
        jitter=(0.0, 0.0),
        columns: tuple[int, int] | None = None,
    ) -> GpuImage:
        """Three texels an instance: object to clip space, for `rows` and `columns` (None: all) of an image of
        `size` pixels, or beyond it."""

    def eye_matrices(self, view: View) -> GpuImage:
        """Six texels an instance: object to world axes about the eye, cofactors, winding and object id."""


class GpuSteps(Device, Protocol):
    """What twins on the GPU call. Values are images and geometry, and dicts, tuples and lists of them."""

    TRIANGLES_PER_DRAW: int

    def new_image(self, shape: tuple[int, ...], dtype=np.float32) -> GpuImage:
        """An image with undefined contents. Raises ValueError where no texture is so large."""

    def new_depth(self, size: tuple[int, int]) -> Any:
        """A depth texture, all 1, for `draw`."""

    def upload(self, array: np.ndarray) -> GpuImage:
        """A float32 or integer array as an image."""

    def upload_table(self, rows: np.ndarray) -> GpuImage:
        """(N, 1 to 4) float32 as a texture that tables.glsl indexes by row number."""

    def stack_columns(self, shape: tuple[int, int, int]) -> int:
        """How many of (layers, height, width) to put side by side in a texture. Raises ValueError."""

    def clear(self, image: GpuImage, value: float) -> None:
        """Sets every component."""

    def constant(self, name: str, make: Callable[[], Any]) -> Any:
        """A value made once and kept as long as the device, such as a constant table."""

    def dispatch(
        self,
        shader: Shader,
        size: tuple[int, int],
        images: dict[str, GpuImage],
        samplers: dict[str, GpuImage] | None = None,
        params: Uniforms | dict[str, Iterable[float]] | None = None,
    ) -> None:
        """Runs a compute shader over `size` invocations. Raises ShaderError, and Cancelled where the flag is
        set."""

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
        """Draws `triangles` (at most TRIANGLES_PER_DRAW), whose vertices the shader pulls by gl_VertexID,
        into `target`; `depth` is a `new_depth` texture, or None. Raises as `dispatch`."""


class RayCaster(Protocol):
    """Rays against the true geometry; positions are relative to `origin`, (3,) float64. `kernels` is the
    native module and `accel` what its functions trace, both for what is asked at very many points."""

    origin: np.ndarray
    kernels: Any
    accel: Any
    cancel_flag: Any

    def transmittance(
        self, casters: np.ndarray, origins: np.ndarray, directions: np.ndarray, t_max: np.ndarray
    ) -> np.ndarray:
        """(N,) float32: how much of the light along each ray gets through what `casters` (instances,) bool
        have within t_max: the product of 1 - opacity, as shadow rays meet it."""

    def nearest(
        self, casters: np.ndarray, origins: np.ndarray, directions: np.ndarray, t_max: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The nearest hit: its parameter (N,) float32, infinite for none, and the instance and the triangle
        of its mesh (N,) int32, -1 for none. Arguments as for `transmittance`."""

    def look(self, pixels: np.ndarray, jitter: np.ndarray, samples: np.ndarray | None = None) -> ViewRays:
        """What the camera sees through `pixels` (N, 2), `jitter` (N, 2) pixels beside their centres: view
        rays with the graph's surface attributes, found by rays. What is partly opaque is there by chance: for
        the `samples` (N,) of a film as it is for those, None: for each ray by itself."""

    def value(self, node: Any) -> Any:
        """What a node of the graph (core/graph.py) holds, on the CPU; made again where it was freed."""

    def texture(self, image: int) -> np.ndarray | None:
        """Texels (h, w, 4) of `outline.images[image]`, None where they could not be read."""
