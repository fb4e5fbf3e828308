"""Every effect, in the order of the panel."""

from ..core.effect import Registry
from .soft_shadow import EFFECT as SOFT_SHADOW
from .toon import EFFECT as TOON
from .volumetric_light import EFFECT as VOLUMETRIC_LIGHT

EFFECTS = Registry((SOFT_SHADOW, VOLUMETRIC_LIGHT, TOON))
