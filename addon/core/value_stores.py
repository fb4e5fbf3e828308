"""Values of nodes that are kept: where, how long, and what goes first."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection
from typing import Any

from .device import Device

Key = tuple
"""The device's name, the node's key, and at the surface which part of it."""


class SceneValues:
    """Of nodes that do not depend on the surface, most recent last, so that what did not change does not run
    again. `most_values` and `most_bytes` bound them, as far as `sizes` (bytes by node) knows what they
    take."""

    def __init__(self, devices: Collection[Device], most_values: int, most_bytes: int | None):
        self._devices = {device.name: device for device in devices}
        self._most_values, self._most_bytes = most_values, most_bytes
        self._values: OrderedDict[Key, Any] = OrderedDict()
        self.sizes: dict[str, int] = {}

    def __contains__(self, key: Key) -> bool:
        return key in self._values

    def get(self, key: Key) -> Any:
        self._values.move_to_end(key)
        return self._values[key]

    def put(self, key: Key, value: Any, device: Device) -> None:
        self._values[key] = value

    def free(self, node: str) -> None:
        """On every device."""
        for name, device in self._devices.items():
            if (name, node) in self._values:
                device.release(self._values.pop((name, node)))

    def keep_only(self, nodes: Collection[str]) -> None:
        self.sizes = {node: size for node, size in self.sizes.items() if node in nodes}
        for node in {key[1] for key in self._values} - set(nodes):
            self.free(node)

    def trim(self) -> None:
        """Drops those that were used longest ago and are too many. In a frame each lamp's maps are read
        before the next lamp's are made; what is wanted again is made again."""
        while len(self._values) > self._most_values:
            (name, _), value = self._values.popitem(last=False)
            self._devices[name].release(value)
        if self._most_bytes is None:
            return
        excess = sum(self.sizes.get(node, 0) for _, node in self._values) - self._most_bytes
        for name, node in [key for key in self._values if key[1] in self.sizes]:
            if excess <= 0:
                break
            excess -= self.sizes[node]
            self._devices[name].release(self._values.pop((name, node)))


class TileValues:
    """Values at the surface of one tile and sample."""

    def __init__(self, devices: Collection[Device]):
        self._devices = {device.name: device for device in devices}
        self._values: dict[Key, Any] = {}

    def __contains__(self, key: Key) -> bool:
        return key in self._values

    def get(self, key: Key) -> Any:
        return self._values[key]

    def put(self, key: Key, value: Any, device: Device) -> None:
        self._values[key] = value

    def forget(self, nodes: Collection[str]) -> None:
        """Not freed by force: a step may hand on what it was given, so that another value shares it."""
        for key in [key for key in self._values if key[1] in nodes]:
            del self._values[key]

    def clear(self) -> None:
        for key, value in self._values.items():
            self._devices[key[0]].release(value)
        self._values.clear()


class FrameValues:
    """Values at the surface that outlive their frame, at most `most_bytes` of them. Frames of one `epoch`
    make one picture: where not all fits, what older epochs used goes first, and then what was made last,
    since the next picture asks for all of it in the same order."""

    def __init__(self, most_bytes: int):
        self._most_bytes = most_bytes
        self.epoch = 0
        self._values: OrderedDict[Key, Any] = OrderedDict()
        self._used: dict[Key, tuple[int, int]] = {}  # bytes, and the epoch that used it last

    def __contains__(self, key: Key) -> bool:
        return key in self._values

    def get(self, key: Key) -> Any:
        self._used[key] = self._used[key][0], self.epoch
        return self._values[key]

    def put(self, key: Key, value: Any, device: Device) -> None:
        self._values[key] = value
        self._used[key] = device.size_of(value), self.epoch

    def clear(self) -> None:
        self._values.clear()
        self._used.clear()

    def trim(self, spared: Collection[Key] = ()) -> None:
        """To the bound, but for what is about to be asked for."""
        excess = sum(size for size, _epoch in self._used.values()) - self._most_bytes
        if excess <= 0:
            return
        keys = [key for key in self._values if key not in spared]
        older = [key for key in keys if self._used[key][1] != self.epoch]
        current = [key for key in keys if self._used[key][1] == self.epoch]
        for key in (*older, *reversed(current)):
            if excess <= 0:
                break
            # Not freed by force: a step may hand on what it was given, so that another value shares it.
            del self._values[key]
            excess -= self._used.pop(key)[0]
