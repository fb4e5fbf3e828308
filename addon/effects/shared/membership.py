"""Which shading points belong to some instances: what light linking and drawn lines ask."""

from __future__ import annotations

import numpy as np

from ...core.device import GpuSteps


def belong(device, surface, instances: frozenset[int]) -> np.ndarray:
    """(h, w) bool on the CPU: whether each point of the surface is of one of the instances; a miss is not."""
    mask = np.append(device.instance_mask(instances), 0).astype(bool)  # index -1, a miss, is the last
    return mask[surface["instance"]]


def mask_table(device: GpuSteps, instances: frozenset[int]):
    """The same for shaders: a table with a row an instance, 1 or 0. To be released."""
    return device.upload_table(device.instance_mask(instances).astype(np.float32)[:, None])
