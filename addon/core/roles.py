"""What a layer is to the picture, and what it is of."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Subject(Enum):
    """What a layer may be of."""

    NOTHING = "the image"
    LAMP = "each light"
    EYE = "the eye"
    OBJECT = "each object"


@dataclass(frozen=True)
class Of:
    """What one layer is of. `index`: a lamp's place in Outline.lights, an object's in Outline.instances."""

    subject: Subject = Subject.NOTHING
    index: int = 0

    @classmethod
    def lamp(cls, index: int) -> Of:
        return cls(Subject.LAMP, index)

    @property
    def is_lamp(self) -> bool:
        return self.subject is Subject.LAMP


THE_IMAGE = Of()


class Role(Enum):
    """What a layer is to the picture."""

    VISIBILITY = "visibility"
    """Share of a lamp's light that arrives: its shadow. One effect provides it for a lamp."""
    FILTER = "filter"
    """What a lamp's light passes on its way, in colour; a lamp may have any number."""
    DIFFUSE = "diffuse"
    """All diffuse light of a lamp, with all that scales it: stands in place of what the composite knows."""
    SPECULAR = "specular"
    """All glossy light of a lamp, with all that scales it; adds."""
    INDIRECT = "indirect"
    """Light that has bounced; adds."""
    AMBIENT = "ambient"
    """Share of the world's light that arrives where no shadow of the sky says so; scales no emission and no
    bounce."""
    TRANSMITTANCE = "transmittance"
    """Share of light that comes through, a lamp's to a surface or a surface's to the eye: by a medium, by a
    screen of dots."""
    SCATTERING = "scattering"
    """Light that a medium sends to the eye, dimmed on its way already; adds."""
    OVER = "over"
    """Lies over the picture by its alpha, premultiplied: layers with a depth (`PlannedLayer.depth`) the
    farthest first at each pixel, then those without."""
    PICTURE = "picture"
    """Made of the picture, and stands in its place: offered (`Effect.offers`), no layer of its own."""
    NONE = "none"
    """Not in the picture."""

    @property
    def scales(self) -> bool:
        """Whether it multiplies light."""
        return self in (Role.VISIBILITY, Role.FILTER, Role.AMBIENT, Role.TRANSMITTANCE)

    @property
    def neutral(self) -> float:
        """What a layer is everywhere where it has nothing to say: joined, it changes nothing."""
        return 1.0 if self.scales else 0.0

    @property
    def is_exclusive(self) -> bool:
        """Whether one effect provides it, for a lamp or for the image, where several could."""
        return self in (Role.VISIBILITY, Role.PICTURE)

    @property
    def needs_lamp(self) -> bool:
        """Whether it can be of a lamp only."""
        return self in (Role.VISIBILITY, Role.FILTER, Role.DIFFUSE, Role.SPECULAR)


PRODUCT = (Role.FILTER, Role.VISIBILITY, Role.TRANSMITTANCE)
"""What scales a lamp's light, in the order in which it does."""
