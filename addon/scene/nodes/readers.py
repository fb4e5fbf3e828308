"""All that enters the registry: whoever reads a graph imports this."""

from . import closures, falloff, numbers, situations, textures

__all__ = ["closures", "falloff", "numbers", "situations", "textures"]
