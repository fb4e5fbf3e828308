"""Recipes (`random_scenes`) that once failed, each made as small as it could be, by what was wrong."""

from __future__ import annotations

_MIST = {"volume": "ShaderNodeVolumeScatter", "density": 0.1}
_GROUND = {"mesh": "square", "scale": (10, 10, 1)}

KEPT: dict[str, dict] = {
    "a medium denser than single precision holds": {
        "lamps": [{"type": "SUN"}],
        "world": {"volume": "ShaderNodeVolumePrincipled", "density": 1e30},
    },
    "a lamp stronger than single precision holds": {
        "lamps": [{"type": "AREA", "energy": 1e38, "color": (1e10, 1, 1), "use_shadow": False}],
        "world": _MIST,
    },
    "an exposure beyond double precision": {
        "things": [_GROUND],
        "lamps": [{"type": "POINT", "exposure": 2000.0}, {"type": "SUN"}],
    },
    "strong light, many samples": {
        "things": [_GROUND],
        "lamps": [{"type": "POINT", "energy": 1e38}],
        "world": _MIST,
        "samples": 4,
    },
    "vertices whose squares are too large": {
        "things": [_GROUND, {"mesh": "3e38", "materials": ("mist",)}],
        "lamps": [{"type": "POINT"}],
    },
    "a medium whose mesh is not all there": {
        "things": [_GROUND, {"mesh": "sliver", "materials": ("smoke",)}],
        "lamps": [{"type": "POINT"}],
        "probes": 64,
    },
    "a glow beyond single precision": {
        "things": [_GROUND, {"materials": ("blazing",)}],
        "lamps": [{"type": "POINT"}],
        "effects": ("toon",),
    },
    "a layer that reads no places": {
        "things": [_GROUND, {}],
        "lamps": [{"type": "SUN", "use_shadow": False}],
        "effects": ("toon",),
        "settings": {"toon.halftone": "off", "toon.outline": "off"},
        "size": (64, 36),
    },
    "no light and one layer": {
        "things": [_GROUND, {}],
        "effects": ("toon",),
        "settings": {"toon.outline": "off", "toon.halftone_anchor": "screen"},
        "size": (64, 36),
    },
    "a neutral layer before one that the frame makes": {
        "things": [_GROUND, {"mesh": "square", "changed": "haired"}],
        "world": {"volume": "ShaderNodeVolumeScatter", "density": 0.05},
        "effects": ("toon", "soft_shadow", "volumetric_light"),
        "offset": (1e7, -1e7, 1e7),
    },
    "rays, and a lamp of no size that touches a mesh": {
        "things": [_GROUND],
        "lamps": [{"type": "POINT", "at": (0, 0, 0)}],
        "settings": {"soft_shadow.method": "hybrid"},
    },
    "rays, and a lamp of hardly any size that touches a mesh": {
        "things": [_GROUND],
        "lamps": [{"type": "POINT", "at": (0, 0, 0), "shadow_soft_size": 1e-42}],
        "settings": {"soft_shadow.method": "hybrid"},
    },
    "a sun's map of a size beyond single precision": {
        "things": [_GROUND, {"mesh": "3e38"}],
        "lamps": [{"type": "SUN"}],
        "backend": "gpu",
    },
    "a dense medium and a lamp a hundred light years away": {
        "lamps": [{"type": "POINT"}],
        "camera": {"at": (0, 0, 0), "parented": True},
        "settings": {
            "volumetric_light.use_scene_medium": False,
            "volumetric_light.scattering_per_m": "1e6,0,1",
        },
        "offset": (1e18, 0, 0),
    },
}
