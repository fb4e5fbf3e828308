"""Settings that several tests bake with."""

MAPS = {"soft_shadow": {"method": "bitmask"}}
"""Soft shadows from depth maps, which the default method has on a GPU alone."""


def maps(**values) -> dict[str, dict]:
    """The same with other values of the effect over them."""
    return {"soft_shadow": MAPS["soft_shadow"] | values}
