"""Numbers of attributes of geometry, as far as Cycles reads them."""

from __future__ import annotations

import bpy
import numpy as np

_KINDS = {
    "FLOAT": ("value", 1, np.float32), "INT": ("value", 1, np.int32), "BOOLEAN": ("value", 1, bool),
    "INT8": ("value", 1, np.int8), "FLOAT2": ("vector", 2, np.float32),
    "FLOAT_VECTOR": ("vector", 3, np.float32), "FLOAT_COLOR": ("color", 4, np.float32),
    "BYTE_COLOR": ("color", 4, np.float32),
}  # fmt: skip


def numbers_of(attribute: bpy.types.Attribute | None) -> np.ndarray | None:
    """(N, 1 to 4) float64, colours linear; None where there is none, or of another type."""
    if attribute is None or attribute.data_type not in _KINDS:
        return None
    field, width, dtype = _KINDS[attribute.data_type]
    flat = np.empty(len(attribute.data) * width, dtype)
    attribute.data.foreach_get(field, flat)
    return flat.reshape(-1, width).astype(np.float64)
