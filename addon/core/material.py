"""What is read of materials: what they stop of light, what of it comes back, what shines by itself."""

from __future__ import annotations

from dataclasses import dataclass

from .medium import Medium
from .params import OwnSettings

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Image:
    """One picture that a material's nodes make, of one image or of several: `channel` is 'COLOR' or, as a
    single float, 'VALUE'. It `repeats` if it is the same in every unit square of texture coordinates. `size`:
    width and height in texels. Whether it can be read shows when it is (see `Arrays.textures`)."""

    name: str
    key: str
    channel: str
    repeats: bool = True
    size: tuple[int, int] = (0, 0)

    @property
    def nbytes(self) -> int:
        """Of its texels."""
        width, height = self.size
        return 4 * width * height * (4 if self.channel == "COLOR" else 1)


@dataclass(frozen=True)
class Opacity:
    """How much of what meets one side of a surface is stopped: 1 all of it, 0 nothing.

    `value` everywhere, or `image`, an index into `Outline.images` sampled by the mesh's UV map,
    repeated and bilinear; then `value` is not used. Either times `corners`, the name of what is calculated
    from attributes of the mesh (`Images.corners` in addon/scene/materials.py), between them linear; empty:
    times nothing. With a `threshold` above 0 it is a clip: 1 where all that is at least so much, else 0.
    """

    value: float = 1.0
    image: int | None = None
    corners: str = ""
    threshold: float = 0.0

    @property
    def is_uniform(self) -> bool:
        """Whether it is the same all over."""
        return self.image is None and not self.corners

    @property
    def is_whole(self) -> bool:
        """Whether it stops everything, all over."""
        return self.is_uniform and self.value >= (self.threshold if self.threshold > 0.0 else 1.0)

    @property
    def is_clear(self) -> bool:
        """Whether it stops nothing, all over."""
        return self.is_uniform and (self.value <= 0.0 or self.value < self.threshold)

    @property
    def is_partial(self) -> bool:
        """Whether it may be neither 1 nor 0 somewhere."""
        return self.threshold <= 0.0 and not (self.is_uniform and (self.value >= 1.0 or self.value <= 0.0))


BothSides = tuple[Opacity, Opacity]
"""Of the front, which is where the corners of a face go round counter-clockwise, and of the back."""
WHOLE: BothSides = (Opacity(), Opacity())


@dataclass(frozen=True)
class Material:
    """What Strata reads of a material. Colours are linear RGB in the working space.

    `base_color_image` indexes `Outline.images`, sampled as an opacity's; then the constant beside is not
    used. Either times `base_color_corners`, as an opacity's `corners`. Diffuse light comes back as by base
    colour times 1 - `metallic`, where metallic is not the same all over with `diffuse_image` and
    `diffuse_corners` in place of base colour's. `emission` has the same two beside it. Pictures lie on the UV
    map `uv_map` (empty: the one for rendering), its coordinates moved by the two rows of `uv_matrix`. Corners
    of a face carry one colour: all that there is of `..._corners` is the same. `seen` is what
    cameras meet, `casts` what shadow rays and shadow maps meet; where a part of that could not be read, it
    counts as opaque and `unread_opacity` is True: at some points it may be anything between 0 and 1. It is
    the luminance of what comes through; `tints` names nodes that give that a colour, which is not read.
    `is_holdout`: a hole for cameras. `medium` fills a mesh of this material where it has no surface.
    """

    name: str
    base_color: Colour = (0.8, 0.8, 0.8)
    base_color_image: int | None = None
    base_color_corners: str = ""
    seen: BothSides = WHOLE
    casts: BothSides = WHOLE
    emission: Colour = (0.0, 0.0, 0.0)
    emission_image: int | None = None
    emission_corners: str = ""
    metallic: float = 0.0
    diffuse_image: int | None = None
    diffuse_corners: str = ""
    medium: Medium | None = None
    has_surface: bool = True
    own_settings: OwnSettings = ()
    unread_opacity: bool = False
    tints: tuple[str, ...] = ()
    is_holdout: bool = False
    uv_map: str = ""
    uv_matrix: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)

    @property
    def opacities(self) -> frozenset[Opacity]:
        """All that it has, of either side and for either use."""
        return frozenset((*self.seen, *self.casts))

    @property
    def base_color_varies(self) -> bool:
        """Whether it may differ from point to point."""
        return self.base_color_image is not None or bool(self.base_color_corners)

    @property
    def emission_varies(self) -> bool:
        return self.emission_image is not None or bool(self.emission_corners)

    @property
    def glows(self) -> bool:
        return self.emission_image is not None or any(self.emission)

    @property
    def diffuse(self) -> tuple[int | None, str]:
        """The picture and the corners of what diffuse light comes back by."""
        if self.diffuse_image is None and not self.diffuse_corners:
            return self.base_color_image, self.base_color_corners
        return self.diffuse_image, self.diffuse_corners

    @property
    def colour_corners(self) -> str:
        """What the corners of faces carry for colours."""
        return self.base_color_corners or self.diffuse_corners or self.emission_corners

    @property
    def is_seen(self) -> bool:
        """Whether a camera meets anything of its surface."""
        return self.has_surface and not all(opacity.is_clear for opacity in self.seen)

    @property
    def casts_shadow(self) -> bool:
        """Whether a shadow ray does."""
        return self.has_surface and not all(opacity.is_clear for opacity in self.casts)

    @property
    def opacity_images(self) -> frozenset[int]:
        return frozenset(opacity.image for opacity in self.opacities if opacity.image is not None)
