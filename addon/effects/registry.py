"""Every effect, in the order of the panel."""

from ..core.effect import Effect
from ..core.errors import StrataError
from .soft_shadow import EFFECT as SOFT_SHADOW
from .toon import EFFECT as TOON
from .volumetric_light import EFFECT as VOLUMETRIC_LIGHT

EFFECTS: tuple[Effect, ...] = (SOFT_SHADOW, VOLUMETRIC_LIGHT, TOON)


def effect_named(name: str) -> Effect:
    """Raises StrataError if there is none."""
    for effect in EFFECTS:
        if effect.id == name:
            return effect
    raise StrataError(f"no effect '{name}'; there is {', '.join(effect.id for effect in EFFECTS)}")
