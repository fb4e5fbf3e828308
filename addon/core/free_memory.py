"""How much memory there is, as the operating system tells it."""

from __future__ import annotations

import ctypes
import os
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

UNKNOWN_FREE_BYTES = 4 << 30
"""Taken where the system does not say."""


def free_bytes() -> int:
    """What a process may still take without others being driven out; within a container, of its share."""
    found = []
    with suppress(OSError, ValueError, StopIteration), open("/proc/meminfo", encoding="ascii") as lines:
        found.append(1024 * int(next(line for line in lines if line.startswith("MemAvailable")).split()[1]))
    group = Path("/sys/fs/cgroup")
    for limit, used in (("memory.max", "memory.current"),
                        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes")):  # fmt: skip
        with suppress(OSError, ValueError):  # "max": no limit
            found.append(int((group / limit).read_text()) - int((group / used).read_text()))
    if not found and sys.platform == "win32":
        found.append(_windows_free_bytes())
    if not found:
        with suppress(OSError, ValueError, AttributeError):  # macOS tells only of all there is
            found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2)
    return max(min(found, default=UNKNOWN_FREE_BYTES), 0)


def held_bytes() -> int:
    """What this process has resident now; 0 where the system does not say."""
    with suppress(OSError, ValueError, IndexError), open("/proc/self/statm", encoding="ascii") as numbers:
        return int(numbers.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return 0


def check_room(count: int) -> None:
    """Raises MemoryError where so many bytes cannot be had: a kernel that runs into it ends the process."""
    np.empty(count, np.uint8)


def give_back() -> None:
    """Gives freed memory back to the system. The C library of Linux keeps blocks below 32 MB for later, and
    a light's maps are made of such: a gigabyte after a few lamps."""
    with suppress(OSError, AttributeError, TypeError):  # where there is no such function
        ctypes.CDLL(None).malloc_trim(0)


def _windows_free_bytes() -> int:
    class Status(ctypes.Structure):
        _fields_ = [("length", ctypes.c_ulong), ("load", ctypes.c_ulong)] + [
            (name, ctypes.c_ulonglong)
            for name in (
                "total",
                "free",
                "total_page",
                "free_page",
                "total_virtual",
                "free_virtual",
                "extended",
            )
        ]

    status = Status(length=ctypes.sizeof(Status))
    return (
        status.free
        if ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))
        else UNKNOWN_FREE_BYTES
    )
