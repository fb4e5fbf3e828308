"""Soft shadows from layered shadow maps; see README.md in this folder."""

from ...core.effect import Effect, LayerKind
from ...core.roles import Role, Subject
from ..shared import visibility_truth
from .gpu_steps import variants
from .params import Method, SoftShadowParams
from .run import needed, ruled_out, run, visibility

EFFECT = Effect(
    id="soft_shadow",
    params=SoftShadowParams,
    layers=(
        LayerKind(
            title="Soft Shadow",
            channels="V",
            score=visibility_truth.SCORE,
            of=Subject.LAMP,
            role=Role.VISIBILITY,
            doc="Share of the light's irradiance that arrives: 1 is lit, 0 is in full shadow",
        ),
    ),
    needed=needed,
    ruled_out=ruled_out,
    run=run,
    doc="Shadows of lights with a size, by projecting the texels of a layered depth map back onto the light",
    offers={Role.VISIBILITY: visibility},
    source="Bavoil, thesis, chapter 5; Schwarz and Stamminger 2007 (bitmask)",
    shaders=variants,
    presets={
        "Draft": {
            "target_error": 0.05,
            "sample_rays": 1,
            "layers": 2,
            "resolution": 512,
            "max_samples": 128,
            "spacing": 2,
        },
        "Default": {},
        "Best": {"target_error": 0.01, "method": Method.RAYS, "sample_rays": 16},
    },
)
