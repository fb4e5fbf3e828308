"""Toon shading: light on a ramp, halftone dots and outlines; see README.md in this folder."""

import math

from ...core.effect import Effect, LayerKind, Need
from ...core.roles import Role
from ...measure.mask import MaskScore
from .gpu_steps import variants
from .params import ToonObjectParams, ToonParams
from .reference import halftone, outline_ink, toon
from .run import needed, ruled_out, run

TOON = LayerKind(
    title="Toon",
    score=MaskScore(toon, "every light by itself"),
    channels="RGBA",
    role=Role.OVER,
    doc="Surfaces in the colours of the ramp, opaque where there is a surface",
)
HALFTONE = LayerKind(
    title="Toon Halftone",
    score=MaskScore(halftone, "dots without filter"),
    channels="V",
    role=Role.TRANSMITTANCE,
    doc="Dots that grow with the shade: 1 is paper, 0 is ink",
    needs=frozenset({Need.EYE}),
    is_weighed=False,
)
OUTLINE = LayerKind(
    title="Toon Outline",
    score=MaskScore(
        outline_ink, "the hull's triangles by rays", probe_seconds=8e-3, pixel_seconds=3e-3, screening_rays=32
    ),
    channels="RGBA",
    role=Role.OVER,
    doc="Lines around objects and, where asked for, within them",
    needs=frozenset({Need.EYE}),
)
EFFECT = Effect(
    id="toon",
    params=ToonParams,
    object_params=ToonObjectParams,
    layers=(TOON, HALFTONE, OUTLINE),
    on_by_default=False,
    needed=needed,
    ruled_out=ruled_out,
    shaders=variants,
    run=run,
    presets={
        "Default": {},
        "Clean": {"halftone": False, "object_lines": True, "crease_angle": math.radians(50.0)},
        "Heavy": {"halftone_scale": 1.05, "halftone_cutoff": 0.4, "outline_width_px": 3.0},
        "Newsprint": {"halftone_repeat": 150.0, "halftone_scale": 1.0, "halftone_opacity": 0.8},
    },
    doc="Light in steps of a colour ramp, with halftone dots in the shade and ink around the objects",
    source="Mobile Toon Shading, GPU Zen (2017), III.3, with its soft light corrected",
)
