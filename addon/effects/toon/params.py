"""Settings of toon shading."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

from ...core.conditions import OneOf, When, both
from ...core.params import Colour, Group, Lamp, Params, param
from ...core.ramp import Ramp

NO_FADE = 1e9  # metres
NO_CREASE = math.pi


class Light(Enum):
    """What the ramp is looked up with."""

    FACING = "facing"
    BRIGHTNESS = "brightness"


class ShadowEdge(Enum):
    """How cast shadows end."""

    CRISP = "crisp"
    SOFT = "soft"


class Normals(Enum):
    """Which normals are shaded."""

    SMOOTH = "smooth"
    FLAT = "flat"


class Mix(Enum):
    """How the ramp's colour meets the material's."""

    SOFT_LIGHT = "soft_light"
    MULTIPLY = "multiply"
    RAMP = "ramp"


class Anchor(Enum):
    """What halftone dots hold on to."""

    SCREEN = "screen"
    OBJECT = "object"
    SURFACE = "surface"


class Unit(Enum):
    """What the outline's width is measured in."""

    PIXEL = "pixel"
    METRE = "metre"


DEFAULT_RAMP = Ramp.parse("0:#77778a,0.12:#b4b4c0,0.4:#ffffff;constant")
INCLUDED = When("excluded", (False,))
OWN_LINE = both(INCLUDED, When("outline", (True,)))

RIM = Group("Rim")
HALFTONE = Group("Halftone", switch="halftone")
OUTLINE = Group("Outline", switch="outline")
INNER_LINES = Group("Inner Lines", used_when=When("outline", (True,)))
ON_SURFACE = When("halftone_anchor", (Anchor.SURFACE,))
HAS_RIM = When("rim", above=0.0)


@dataclass(frozen=True)
class ToonObjectParams(Params):
    """Of an object or a material. A material's ramp gives way to an object's; its outline is left out where
    every material of the object says so."""

    excluded: bool = param(False, label="Leave Out", doc="Leave it to the picture below")
    use_ramp: bool = param(False, label="Own Ramp", used_when=INCLUDED, doc="It has a ramp of its own")
    ramp: Ramp = param(DEFAULT_RAMP, used_when=both(INCLUDED, When("use_ramp", (True,))), doc="That ramp")
    outline: bool = param(True, used_when=INCLUDED, doc="It has an outline")
    outline_scale: float = param(
        1.0,
        hard=(0.0, 100.0),
        soft=(0.0, 4.0),
        label="Line Scale",
        object_only=True,
        used_when=OWN_LINE,
        doc="The object's outline is so many times as wide",
    )
    use_outline_color: bool = param(
        False,
        label="Own Ink",
        object_only=True,
        used_when=OWN_LINE,
        doc="The object's outline has a colour of its own",
    )
    outline_color: Colour = param(
        Colour(0.0, 0.0, 0.0),
        hard=(0.0, 1e6),
        soft=(0.0, 1.0),
        label="Ink Color",
        object_only=True,
        used_when=both(OWN_LINE, When("use_outline_color", (True,))),
        doc="That colour",
    )


@dataclass(frozen=True)
class ToonParams(Params):
    light: Light = param(
        Light.FACING,
        doc="Light on the ramp: facing is the cosine to them, brightness is what a white surface sends back",
    )
    key_light: Lamp = param(Lamp(""), doc="The only light that counts, by name; without one all of them do")
    exposure: float = param(
        1.0,
        hard=(0.0, 1e6),
        soft=(0.0, 4.0),
        used_when=When("light", (Light.BRIGHTNESS,)),
        doc="Brightness is multiplied by this before the ramp",
    )
    shadows: bool = param(True, doc="Cast shadows")
    shadow_edge: ShadowEdge = param(
        ShadowEdge.CRISP,
        used_when=When("shadows", (True,)),
        doc="Crisp shadows are exact, by a ray to the middle of each light; soft ones are Soft Shadow's own",
    )
    normals: Normals = param(
        Normals.SMOOTH, doc="Shade smooth normals, or each face as a flat piece of paper"
    )
    ramp: Ramp = param(
        DEFAULT_RAMP,
        doc="Colours from shade (left) to light (right); alpha is how much of them there is",
    )
    mix: Mix = param(
        Mix.MULTIPLY,
        doc="Ramp over base colour: soft light as in print, multiply, or the ramp's own colour alone",
    )
    emission: float = param(
        1.0, hard=(0.0, 1e6), soft=(0.0, 4.0), doc="How much of the materials' emission is added after"
    )
    rim: float = param(
        0.0,
        hard=(0.0, 1.0),
        label="Strength",
        group=RIM,
        doc="Strength of a band along edges that turn away from the eye",
    )
    rim_width: float = param(
        0.3,
        hard=(0.0, 1.0),
        label="Width",
        group=RIM,
        used_when=HAS_RIM,
        doc="The band begins where the cosine to the eye falls below this",
    )
    rim_color: Colour = param(
        Colour(1.0, 1.0, 1.0),
        hard=(0.0, 1e6),
        soft=(0.0, 1.0),
        label="Color",
        group=RIM,
        used_when=HAS_RIM,
        doc="Colour of the band",
    )
    halftone: bool = param(True, group=HALFTONE, doc="Make the layer of halftone dots")
    halftone_repeat: float = param(
        90.0,
        hard=(1.0, 10000.0),
        soft=(20.0, 300.0),
        label="Dots Up",
        group=HALFTONE,
        used_when=When("halftone_anchor", (Anchor.SCREEN, Anchor.OBJECT)),
        doc="Dots along the height of the frame",
    )
    halftone_scale: float = param(
        0.85,
        hard=(0.0, 10.0),
        soft=(0.0, 2.0),
        label="Dot Size",
        group=HALFTONE,
        doc="Dot size in full shade, in cells; dots touch at 1 and fill everything from 1.42 on",
    )
    halftone_cutoff: float = param(
        0.45,
        hard=(0.0, 10.0),
        soft=(0.0, 2.0),
        label="Least Size",
        group=HALFTONE,
        doc="Smaller dots than this are left out",
    )
    halftone_angle: float = param(
        math.pi / 4.0,
        hard=(-1e4, 1e4),
        soft=(-math.pi, math.pi),
        unit="rad",
        label="Angle",
        group=HALFTONE,
        doc="Turn of the rows of dots",
    )
    halftone_opacity: float = param(
        1.0, hard=(0.0, 1.0), label="Opacity", group=HALFTONE, doc="Blackness of the ink"
    )
    halftone_fade_start_m: float = param(
        NO_FADE,
        hard=(0.0, NO_FADE),
        soft=(0.0, 100.0),
        unit="m",
        label="Fade Start",
        group=HALFTONE,
        used_when=When("halftone_fade_end_m", below=NO_FADE),
        unlimited="At the End",
        doc="Dots fade from this distance to the eye on",
    )
    halftone_fade_end_m: float = param(
        NO_FADE,
        hard=(0.0, NO_FADE),
        soft=(0.0, 100.0),
        unit="m",
        label="Fade End",
        group=HALFTONE,
        unlimited="Never",
        doc="Dots are gone from this distance on",
    )
    halftone_anchor: Anchor = param(
        Anchor.SCREEN,
        label="Anchor",
        group=HALFTONE,
        doc="Dots hold on to the screen, to where each object's origin is on it, or to the surface itself",
    )
    halftone_cell_m: float = param(
        0.05,
        hard=(1e-6, 1e6),
        soft=(0.001, 1.0),
        unit="m",
        label="Dot Spacing",
        group=HALFTONE,
        used_when=ON_SURFACE,
        doc="Distance of dots where they hold on to the surface",
    )
    outline: bool = param(True, group=OUTLINE, doc="Make the layer of outlines")
    outline_unit: Unit = param(
        Unit.PIXEL,
        label="Width In",
        group=OUTLINE,
        words={"pixel": "Pixels", "metre": "Metres"},
        doc="Whether the width below in pixels or that in metres counts",
    )
    outline_width_px: float = param(
        2.0,
        hard=(0.0, 256.0),
        soft=(0.0, 10.0),
        unit="pixel",
        label="Width",
        group=OUTLINE,
        used_when=When("outline_unit", (Unit.PIXEL,)),
        doc="Width of the line around a silhouette",
    )
    outline_width_m: float = param(
        0.01,
        hard=(0.0, 1e6),
        soft=(0.0, 0.1),
        unit="m",
        label="Width",
        group=OUTLINE,
        used_when=When("outline_unit", (Unit.METRE,)),
        doc="The same as a length in the scene",
    )
    outline_least_px: float = param(
        0.0,
        hard=(0.0, 256.0),
        soft=(0.0, 10.0),
        unit="pixel",
        label="At Least",
        group=OUTLINE,
        doc="Lines are at least so wide, however far away",
    )
    outline_most_px: float = param(
        64.0,
        hard=(0.0, 256.0),
        unit="pixel",
        label="At Most",
        group=OUTLINE,
        doc="Lines are at most so wide, however close",
    )
    outline_color: Colour = param(
        Colour(0.0, 0.0, 0.0),
        hard=(0.0, 1e6),
        soft=(0.0, 1.0),
        label="Ink Color",
        group=OUTLINE,
        doc="Colour of the ink",
    )
    outline_thickness: str = param(
        "",
        label="Thickness",
        group=OUTLINE,
        doc="Vertex group or attribute of vertices that scales the width, where a mesh has it",
    )
    object_lines: bool = param(
        False, label="Of Objects", group=INNER_LINES, doc="Also draw where one object meets another"
    )
    material_lines: bool = param(
        False, label="Of Materials", group=INNER_LINES, doc="Also draw where one material meets another"
    )
    crease_angle: float = param(
        NO_CREASE,
        hard=(0.0, math.pi),
        unit="rad",
        group=INNER_LINES,
        unlimited="Never",
        doc="Also draw where normals on both sides differ by more than this; half a turn is never",
    )
    line_width_px: int = param(
        1,
        hard=(1, 16),
        unit="pixel",
        label="Width",
        group=INNER_LINES,
        used_when=OneOf(
            (
                When("object_lines", (True,)),
                When("material_lines", (True,)),
                When("crease_angle", below=NO_CREASE),
            )
        ),
        doc="Width of these inner lines",
    )

    def lighter(self, share: float) -> ToonParams:
        """Without rays: a hierarchy for those takes longer than a frame to build."""
        return replace(self, shadow_edge=ShadowEdge.SOFT)
