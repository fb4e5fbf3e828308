"""What the shaders of soft shadows are told in numbers."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.uniforms import Four, Three, Two, Uniforms


@dataclass(frozen=True)
class MapParams(Uniforms):
    """Of a prepared map (map.glsl): texels of a layer, `columns` of layers side by side, and the bias along
    slopes."""

    map_size: Two = (0.0, 0.0)
    layers: float = 0.0
    columns: float = 0.0
    gradient_scale: float = 0.0
    gradient_cap_m: float = 0.0
    levels: float = 0.0
    nodes: float = 0.0


@dataclass(frozen=True)
class PrepareParams(MapParams):
    """`depth_columns`: layers side by side in the depths that are read."""

    depth_columns: float = 0.0


@dataclass(frozen=True)
class PyramidParams(MapParams):
    """`level` that is made."""

    level: float = 0.0


@dataclass(frozen=True)
class LightParams(MapParams):
    """A light, in the axes of its map's view (light.rs), and what is to be done: for `size` pixels, every
    `stride`-th of them, of a grid of `spacing`; for the map `index` of those from `nest_first` to `nest_end`,
    which is the only such run where it `is_alone`; -1 for no map. `eye_offset`: from the view's eye to the
    surface's in those axes, `from_light` in the world's; `inner`: the window of the next smaller map."""

    size: Two = (0.0, 0.0)
    stride: float = 1.0
    spacing: float = 1.0
    most_texels: float = 0.0
    refinements: float = 0.0
    index: float = -1.0
    nest_first: float = 0.0
    nest_end: float = 0.0
    is_alone: float = 0.0
    window_low: Two = (0.0, 0.0)
    texel_size: Two = (0.0, 0.0)
    window_high: Two = (0.0, 0.0)
    leaves_uncertain: float = 0.0
    inner: Four = (0.0, 0.0, 0.0, 0.0)
    axis_x: Three = (0.0, 0.0, 0.0)
    axis_y: Three = (0.0, 0.0, 0.0)
    axis_z: Three = (0.0, 0.0, 0.0)
    eye_offset: Three = (0.0, 0.0, 0.0)
    from_light: Three = (0.0, 0.0, 0.0)
    half_size: Two = (0.0, 0.0)
    tan_half_spread: float = 0.0
    cos_cone: float = 0.0
    cone_sharpness: float = 0.0
    cone_axis: Three = (0.0, 0.0, 0.0)
