"""Light scattered by a homogeneous medium, with the shadows in it; see README.md in this folder."""

from ...core.effect import Effect, LayerKind, Need
from ...core.roles import Role, Subject
from ...measure.in_use import InUseScore
from ...measure.light import LightScore
from ..shared.light_truth import over_the_picture
from .gpu_steps import variants
from .params import VolumetricLightParams
from .reference import scattered, transmitted
from .run import needed, ruled_out, run

EFFECT = Effect(
    id="volumetric_light",
    params=VolumetricLightParams,
    layers=(
        LayerKind(
            title="Volumetric",
            channels="RGB",
            score=LightScore(scattered, "ray marched, 2 x 512 shadow rays"),
            of=Subject.LAMP,
            role=Role.SCATTERING,
            doc="Radiance that the medium scatters once from the light towards the eye, W/(m² sr)",
        ),
        LayerKind(
            title="Transmittance",
            channels="RGB",
            score=InUseScore(over_the_picture(transmitted), reference_name="exact"),
            of=Subject.EYE,
            role=Role.TRANSMITTANCE,
            doc="Share of a surface's light that the medium lets through to the eye",
        ),
    ),
    needed=needed,
    needs=frozenset({Need.EYE}),
    ruled_out=ruled_out,
    run=run,
    doc="Shafts of light and fog, from the lit stretches of each view ray and the integral along them",
    source="GPU Zen, II.2, participating media by extruded light volumes; walked here instead of extruded",
    shaders=variants,
)
