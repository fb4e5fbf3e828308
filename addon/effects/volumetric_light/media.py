"""Which medium a scene is seen through."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.medium import Medium
from ...core.outline import Outline
from .params import VolumetricLightParams


@dataclass(frozen=True)
class Fill:
    """A medium and the instances that it fills; None: it is everywhere."""

    medium: Medium
    instances: frozenset[int] | None = None


def surely_none(params: VolumetricLightParams, has_media: bool) -> bool:
    """Whether there is no medium in any frame; `has_media`: some material or the world has a volume."""
    if params.use_scene_medium:
        return not has_media
    return Medium(tuple(params.scattering_per_m), tuple(params.absorption_per_m), params.anisotropy).is_empty


def fill_of(outline: Outline, params: VolumetricLightParams) -> tuple[Fill | None, list[tuple[str, str]]]:
    """The medium, None where there is none, and what was left out for it, and why."""
    if not params.use_scene_medium:
        medium = Medium(tuple(params.scattering_per_m), tuple(params.absorption_per_m), params.anisotropy)
        return (None if medium.is_empty else Fill(medium)), []
    meshes = outline.instances.media
    if outline.world_medium is not None:
        names = ((f"volume {each.name}", "the world's volume is everywhere already") for _, each in meshes)
        return Fill(outline.world_medium), list(names)
    if not meshes:
        return None, []
    # Media that differ would have to attenuate each other: the largest is the one that is seen.
    largest = max(meshes, key=lambda pair: pair[1].bounds.radius)[1].medium
    left = [
        (f"volume {each.name}", "one medium at a time: a larger mesh has another")
        for _, each in meshes
        if each.medium != largest
    ]
    return Fill(largest, frozenset(i for i, each in meshes if each.medium == largest)), left
