"""The CPU device: the only importer of the native kernels."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from queue import Empty, SimpleQueue
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import strata_kernels

from ..core.arrays import CLEAR, Arrays, MeshArrays, OpacityArrays, Placed, bytes_of
from ..core.graph import Node
from ..core.outline import Outline
from ..core.shot import Shot
from ..core.surface import Chunk
from ..core.view import Vector
from ..core.view_rays import ViewRays
from .camera_rays import CameraRays
from .chart import LaidOut, chart_points, lay_out

POLL_SECONDS = 0.01


def triangulate(mesh: MeshArrays) -> tuple[np.ndarray, np.ndarray]:
    """Corners of each triangle (T, 3) and its face (T,), int32, as in `CpuDevice.geometry`."""
    return strata_kernels.triangulate(mesh.positions, mesh.corner_vertices, mesh.face_starts)


def extent(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corner, float64, of the box around (N, 3) float32; NaN where any is not finite."""
    low, high = strata_kernels.extent(np.ascontiguousarray(points))
    return np.array(low, np.float64), np.array(high, np.float64)


def write_positions(positions: np.ndarray, centre: np.ndarray, rows: np.ndarray) -> None:
    """(N, 3) float32 less a centre into `rows` (N, 4) float32."""
    strata_kernels.position_rows(np.ascontiguousarray(positions), centre.astype(np.float32).tolist(), rows)


def write_triangles(vertices: np.ndarray, order: np.ndarray | None, rows: np.ndarray) -> None:
    """Vertices (T, 3) int32 and each triangle's number, its index if `order` is None, into `rows` (T, 4)
    float32."""
    strata_kernels.triangle_rows(np.ascontiguousarray(vertices, np.int32), order, rows)


class CpuDevice:
    """Runs the Rust kernels; its values are numpy arrays and kernel handles."""

    name = "cpu"
    traces_rays = True
    compile_seconds = 0.0
    cancelled = (strata_kernels.Cancelled,)

    def __init__(self, cancel_flag: strata_kernels.CancelFlag | None = None):
        self.kernels = strata_kernels
        self.cancel_flag = cancel_flag or strata_kernels.CancelFlag()
        self.description = f"native kernels, {os.cpu_count()} threads"
        self._outline: Outline | None = None
        self._arrays: Arrays | None = None
        self._meshes: WeakKeyDictionary[MeshArrays, strata_kernels.Mesh] = WeakKeyDictionary()
        self._opacities: WeakKeyDictionary[OpacityArrays, strata_kernels.Opacity] = WeakKeyDictionary()

    def set_scene(self, outline: Outline, arrays: Arrays) -> None:
        """The scene that `geometry` is made of from now on."""
        self._outline, self._arrays = outline, arrays

    def geometry(self) -> strata_kernels.Geometry:
        """Every instance of the scene, at its index in the outline. Meshes that an earlier scene had (the
        same MeshArrays) are not read again."""
        return self.geometry_of(self._outline.instances, self._arrays)

    def geometry_without(self, materials: frozenset[int]) -> strata_kernels.Geometry:
        """The same, with surfaces of these materials as though they were not there."""
        opacities = enumerate(self._arrays.opacities)
        cleared = tuple(CLEAR if index in materials else each for index, each in opacities)
        return self.geometry_of(self._outline.instances, replace(self._arrays, opacities=cleared))

    def geometry_of(self, instances: Sequence[Placed], arrays: Arrays) -> strata_kernels.Geometry:
        """`instances` of the meshes of `arrays`, which are no part of the scene, say."""
        geometry = strata_kernels.Geometry()
        for mesh in arrays.meshes:
            geometry.add_shared_mesh(self._triangles(mesh))
        for material in arrays.opacities:
            sides = material.seen, material.casts
            geometry.add_material(*(tuple(map(self._opacity, both)) for both in sides))
        for instance, matrix in zip(instances, arrays.matrices, strict=True):
            geometry.add_instance(instance.mesh, matrix, instance.object_id, list(instance.materials))
        return geometry

    def _triangles(self, mesh: MeshArrays) -> strata_kernels.Mesh:
        if mesh not in self._meshes:
            self._meshes[mesh] = strata_kernels.Mesh(
                mesh.positions,
                mesh.corner_vertices,
                mesh.face_starts,
                mesh.corner_normals,
                mesh.corner_uvs,
                mesh.face_slots,
                mesh.corner_opacity,
                mesh.corner_colours,
            )
        return self._meshes[mesh]

    def _opacity(self, opacity: OpacityArrays) -> strata_kernels.Opacity:
        if opacity not in self._opacities:
            self._opacities[opacity] = strata_kernels.Opacity(
                opacity.value, opacity.texels, opacity.by_corner, opacity.threshold
            )
        return self._opacities[opacity]

    def distance_m(self, instance: int, place: Vector, most_m: float) -> float:
        """From a place in the world to the triangles of the instance; `most_m` if none is nearer."""
        arrays = self._arrays
        mesh = self._triangles(arrays.meshes[self._outline.instances[instance].mesh])
        return mesh.distance(arrays.matrices[instance], list(place), most_m)

    def laid_out(self, geometry: strata_kernels.Geometry, instances: frozenset[int]) -> LaidOut:
        """The triangles of these instances where their UV maps put them, for `chart`."""
        return lay_out(geometry, self.geometry_of, triangulate, self._outline, self._arrays, instances)

    def chart(
        self, laid_out: LaidOut, origin: Vector, chunk: Chunk, attributes: frozenset[str]
    ) -> dict[str, np.ndarray]:
        """Their shading points at the chunk's texels, positions relative to `origin`."""
        return chart_points(self.kernels, self.cancel_flag, laid_out, origin, chunk, attributes)

    def vertex_values(self, name: str) -> list[tuple[int, np.ndarray]]:
        """Meshes whose vertices have values of that name, which the graph asked for: index and (V,)
        float32."""
        meshes = enumerate(self._arrays.meshes)
        return [(index, mesh.vertex_values[name]) for index, mesh in meshes if name in mesh.vertex_values]

    def instance_mask(self, instances: frozenset[int]) -> np.ndarray:
        """(instance count,) uint8, 1 at `instances`."""
        mask = np.zeros(len(self._outline.instances), np.uint8)
        mask[sorted(instances)] = 1
        return mask

    def unless_cancelled[Result](self, work: Callable[[], Result]) -> Result:
        """What `work()` returns. For kernels that cannot stop in the middle: it has its own thread, which
        is left to end by itself once the flag is set. Raises Cancelled then, and whatever `work` raises."""
        ended: SimpleQueue = SimpleQueue()

        def run() -> None:
            try:
                ended.put((work(), None))
            except BaseException as failure:  # a panic of the kernels is no Exception
                ended.put((None, failure))

        threading.Thread(target=run, daemon=True).start()
        while True:
            try:
                result, failure = ended.get(timeout=POLL_SECONDS)
            except Empty:
                if self.cancel_flag.is_set():
                    raise strata_kernels.Cancelled("cancelled") from None
                continue
            if failure is not None:
                raise failure
            return result

    def camera_rays(
        self,
        shot: Shot,
        visible: frozenset[int],
        attributes: frozenset[str],
        seed: int,
        holdouts: frozenset[int] = frozenset(),
    ) -> CameraRays:
        """Fills the surface `attributes` of the instances `visible` along any view ray of the shot; `seed` of
        its surface's draws, and `holdouts`."""
        mask = self.instance_mask(visible)
        if not attributes & {"depth", "position"}:
            attributes |= {"depth"}  # how far a ray sees
        return CameraRays(shot, mask, attributes, seed, holdouts)

    def offsets(self, chunk: Chunk) -> np.ndarray | None:
        """Where each of its pixels is sampled (Device.offsets)."""
        if chunk.places is None:
            return None
        return self.kernels.pixel_offsets(
            chunk.places.seed,
            chunk.sample,
            chunk.places.table,
            (chunk.y0, chunk.y1),
            (chunk.x0, chunk.x1),
            cancel=self.cancel_flag,
        )

    def texture(self, image: int) -> np.ndarray | None:
        """Texels of `outline.images[image]`, None where they could not be read."""
        return self._arrays.textures.get(image)

    def to_host(self, value: Any) -> Any:
        return value

    def from_host(self, value: Any) -> Any:
        return value

    def cropped(self, value: Any, first: tuple[int, int], shape: tuple[int, int]) -> Any:
        if isinstance(value, dict):
            return {name: self.cropped(each, first, shape) for name, each in value.items()}
        rows, columns = (slice(start, start + side) for start, side in zip(first, shape, strict=True))
        return np.ascontiguousarray(value[rows, columns])

    def size_of(self, value: Any) -> int:
        return bytes_of(value)

    def finish(self) -> None:
        pass

    def release(self, value: Any) -> None:
        pass


class CpuRays:
    """A RayCaster over a kernel's bounding volume hierarchy. `camera`: what `look` asks, and `value` and
    `texture` are."""

    kernels = strata_kernels

    def __init__(
        self,
        accel: strata_kernels.Accel,
        origin: np.ndarray,
        cancel_flag=None,
        camera=None,
        value: Callable[[Node], Any] | None = None,
        texture: Callable[[int], np.ndarray | None] | None = None,
    ):
        self.accel = accel
        self.value = value
        self.texture = texture
        self.origin = origin
        self.cancel_flag = cancel_flag
        self.camera: CameraRays | None = camera

    def nearest(
        self, casters: np.ndarray, origins: np.ndarray, directions: np.ndarray, t_max: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.accel.nearest(casters, origins, directions, t_max, cancel=self.cancel_flag)

    def look(self, pixels: np.ndarray, jitter: np.ndarray, samples: np.ndarray | None = None) -> ViewRays:
        return self.camera.look(self.kernels, self.accel, self.cancel_flag, pixels, jitter, samples)

    def transmittance(
        self, casters: np.ndarray, origins: np.ndarray, directions: np.ndarray, t_max: np.ndarray
    ) -> np.ndarray:
        return self.accel.transmittance(casters, origins, directions, t_max, cancel=self.cancel_flag)
