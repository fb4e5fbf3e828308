"""Draws recipes of scenes (`random_scenes`) from end to end of what Blender and the effects let one set."""

from __future__ import annotations

import math

from hypothesis import strategies as st
from strata.addon.core.params import Colour
from strata.addon.core.ramp import Ramp
from strata.addon.effects.registry import EFFECTS
from strata.tests.bake.random_materials import MATERIALS
from strata.tests.bake.random_things import CHANGES, MESHES, OTHERS


def _numbers(*choices: float):
    return st.sampled_from(choices)


def _maybe(**fields):
    """A dict of any of these."""
    return st.fixed_dictionaries({}, optional=fields)


def _near(size: float = 4.0):
    return st.floats(-size, size, width=16)


def _points(size: float = 4.0):
    return st.tuples(_near(size), _near(size), _near(size))


_SCALES = st.one_of(
    st.just((1, 1, 1)),
    st.tuples(*[_numbers(1, 2, 0.1, 10, 100, -1, 0, 1e-3, 1e-6, 1e5, 1e-20, 1e10)] * 3),
    _numbers(-1, 0, 1e-4, 1e4, 1e-12, 1e12).map(lambda s: (s, s, s)),
)

LAMPS = st.fixed_dictionaries(
    {"type": _numbers("POINT", "SUN", "SPOT", "AREA")},
    optional={
        "at": _points(6.0),
        "to": _points(),
        "scale": _SCALES,
        "energy": _numbers(100.0, 1.0, 0.0, -10.0, 1e10, 1e-20, 1e38, 3e38),
        "exposure": _numbers(0.0, 3.0, -10.0, 10.0),
        "color": st.sampled_from([(1, 1, 1), (1, 0, 0), (0, 0, 0), (1e10, 1, 1)]),
        "use_shadow": st.booleans(),
        "normalize": st.booleans(),
        "use_temperature": st.booleans(),
        "temperature": _numbers(800.0, 6500.0, 20000.0),
        "shadow_soft_size": _numbers(0.1, 0.0, 1e-6, 1.0, 10.0, 1e4),
        "use_soft_falloff": st.booleans(),
        "angle": _numbers(0.01, 0.0, 1e-6, 0.5, math.pi),
        "spot_size": _numbers(0.8, 0.0175, math.pi, 2.0),
        "spot_blend": _numbers(0.15, 0.0, 1.0),
        "shape": _numbers("SQUARE", "RECTANGLE", "DISK", "ELLIPSE"),
        "size": _numbers(1.0, 0.0, 1e-6, 0.1, 10.0, 1e4),
        "size_y": _numbers(1.0, 0.0, 1e-6, 10.0),
        "spread": _numbers(math.pi, 0.0, 0.0175, 1.0),
        "linked": st.booleans(),
        "blocked": st.booleans(),
        "nodes": st.sampled_from([1.0, 0.0, 100.0, "none", "texture"]),
        "instanced": st.just(True),
    },
)

THINGS = st.fixed_dictionaries(
    {"mesh": st.sampled_from([*MESHES, *OTHERS])},
    optional={
        "at": _points(),
        "turn": st.floats(0.0, 7.0, width=16),
        "scale": _SCALES,
        "materials": st.lists(st.sampled_from([*MATERIALS, ""]), max_size=3),
        "hidden": st.lists(
            st.sampled_from(
                [
                    "visible_camera",
                    "visible_shadow",
                    "visible_diffuse",
                    "hide_render",
                    "is_holdout",
                    "is_shadow_catcher",
                ]
            ),
            max_size=2,
        ),
        "changed": st.sampled_from([*CHANGES]),
    },
)
_GROUND = {"mesh": "square", "scale": (10, 10, 1)}

CAMERAS = _maybe(
    at=_points(6.0),
    to=_points(),
    scale=_SCALES,
    type=_numbers("PERSP", "ORTHO", "PANO"),
    lens=_numbers(50.0, 1.0, 5.0, 5000.0),
    ortho_scale=_numbers(6.0, 1e-3, 1e4),
    shift_x=_numbers(0.0, 0.5, -10.0, 10.0),
    shift_y=_numbers(0.0, -0.5, 10.0),
    clip_start=_numbers(0.1, 1e-6, 1.0, 100.0),
    clip_end=_numbers(100.0, 0.1, 1e-6, 1e6, 1e30),
    parented=st.just(True),
)

_UNIT = st.floats(0.0, 1.0, width=16)


def _values_of(spec):
    """Words for a parameter: anything in its hard range that does not cost minutes."""
    if spec.choices:
        return st.sampled_from(spec.choices)
    if spec.kind is bool:
        return st.booleans()
    if issubclass(spec.kind, str):
        return st.sampled_from(["", "Lamp", "nobody"])
    if spec.kind is Colour:
        return st.sampled_from(["1,1,1", "0,0,0", "1e6,0,1", "0.1,0.2,0.3"])
    if spec.kind is Ramp:
        return st.sampled_from(
            [
                str(spec.default),
                "0:#000000,1:#ffffff;linear",
                "0.5:#ff0000;constant",
                "0:#000000,0:#ffffff;ease",
            ]
        )
    low, high = spec.hard
    if spec.kind is int:
        most = min(high, max(spec.default // 2, low + 8)) if spec.trades_time else high
        return st.sampled_from(sorted({int(low), int(most), min(int(spec.default), int(most))}, reverse=True))
    return st.sampled_from([spec.default, low, high, low + 0.3 * min(high - low, 1.0)])


SETTINGS = _maybe(
    **{f"{effect.id}.{spec.name}": _values_of(spec) for effect in EFFECTS for spec in effect.params.specs()}
)

_EDGES = st.tuples(_UNIT, _UNIT).map(sorted)
_REGIONS = st.tuples(_EDGES, _EDGES, st.booleans()).map(
    lambda drawn: (drawn[0][0], drawn[1][0], drawn[0][1], drawn[1][1], drawn[2])
)
VOLUMES = ("ShaderNodeVolumeScatter", "ShaderNodeVolumeAbsorption", "ShaderNodeVolumePrincipled")

RECIPES = st.fixed_dictionaries(
    {
        "things": st.one_of(
            st.just([]),
            st.lists(THINGS, max_size=4).map(lambda some: [_GROUND, *some]),
            st.lists(THINGS, max_size=4),
        ),
        "lamps": st.lists(LAMPS, max_size=5),
        "backend": st.sampled_from(["cpu", "cpu", "cpu", "gpu"]),
        "samples": st.integers(1, 4),
        "probes": _numbers(0, 1, 2, 16, 64),
        "settings": SETTINGS,
    },
    optional={
        "camera": CAMERAS,
        "world": st.fixed_dictionaries(
            {"volume": st.sampled_from(VOLUMES), "density": _numbers(0.05, 0.0, 1e-8, 1.0, 1e4, 1e30, -1.0)},
            optional={"anisotropy": _numbers(0.0, 0.9, -0.5, 1.0, -1.0)},
        ),
        "offset": st.sampled_from([(1e7, -1e7, 1e7), (100.0, 0.0, 0.0), (1e3, 1e4, -1e5), (1e18, 0, 0)]),
        "region": _REGIONS,
        "size": st.sampled_from([(32, 18), (4, 4), (5, 64), (64, 5)]),
        "pixel_aspect": st.sampled_from([(1.0, 1.0), (2.0, 1.0), (1.0, 200.0)]),
        "effects": st.lists(st.sampled_from([effect.id for effect in EFFECTS]), min_size=1, unique=True),
    },
)
