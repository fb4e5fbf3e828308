"""Texels of pictures, kept from one extraction to the next while they would come out the same."""

from __future__ import annotations

from collections.abc import Mapping

import bpy
import numpy as np

from .nodes.pictures import Picture
from .pixels import content_of, pixels_of

Read = tuple[np.ndarray | None, list[str]]
"""As `Picture.texels` returns it."""


class KnownTexels:
    """Those of the last extraction. To evaluate a picture takes seconds; to see that the pixels in its images
    are the same takes a hundredth of that. Blender does not tell of everything that writes to them. Only on
    the main thread. `are_kept`: for the next extraction; where there is none, nothing is compared."""

    def __init__(self, are_kept: bool = True):
        self._are_kept = are_kept
        self._known: dict[tuple, Read] = {}

    def read(self, pictures: Mapping[int, Picture]) -> dict[int, Read]:
        """Of all these, by the same indices. All others are forgotten."""
        pixels: dict[int, np.ndarray | None] = {}
        contents: dict[int, tuple] = {}

        def load(image: bpy.types.Image) -> np.ndarray | None:
            if image.session_uid not in pixels:
                pixels[image.session_uid] = pixels_of(image)
            return pixels[image.session_uid]

        def content(image: bpy.types.Image) -> tuple:
            if image.session_uid not in contents:
                contents[image.session_uid] = content_of(image)
            return contents[image.session_uid]

        used: dict[tuple, Read] = {}
        last = {image.session_uid: index for index, each in pictures.items() for image in each.images}
        found = {}
        for index, picture in pictures.items():
            # What the nodes say is in linear colours of the working space.
            made_of = (
                picture.key,
                bpy.data.colorspace.working_space,
                *(content(image) for image in picture.images if self._are_kept),
            )
            if made_of not in used:
                known = self._known.get(made_of)
                used[made_of] = picture.texels(load) if known is None else known
            found[index] = used[made_of]
            # Sixteen bytes a texel: only while some picture to come is made of them.
            for image in picture.images:
                if last[image.session_uid] == index:
                    pixels.pop(image.session_uid, None)
        self._known = used
        return found
