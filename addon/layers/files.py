"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from ..core.errors import StrataError


def check_writable(path: str | Path) -> None:
    """Raises StrataError where `replaced` would surely fail: asked before the work, not after it."""
    path = Path(os.path.realpath(path))
    folder = _there(path.parent)
    if not folder.is_dir():
        raise StrataError(f"cannot write {path}: {folder} is not a folder")
    try:
        path.lstat()
    except FileNotFoundError:
        pass
    except OSError as error:  # a name too long, a folder that may not be searched
        raise StrataError(f"cannot write {path}: {error.strerror or error}") from None
    if path.is_dir():
        raise StrataError(f"cannot write {path}: it is a folder")
    if path.exists() and not path.is_file():
        raise StrataError(f"cannot write {path}: it is not a regular file")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise StrataError(f"cannot write {path}: the folder {folder} is not writable")


def free_on_disk(path: str | Path) -> float:
    """Bytes that are left where a file is to be; infinite where nobody says."""
    try:
        usage = shutil.disk_usage(_there(Path(os.path.realpath(path)).parent))
        return usage.free if usage.total else float("inf")  # of no disk, as /proc is
    except OSError:
        return float("inf")


def _there(folder: Path) -> Path:
    """What of a path exists already."""
    while not os.path.lexists(folder) and folder != folder.parent:
        folder = folder.parent
    return folder


@contextmanager
def _folder(path: Path) -> Iterator[None]:
    """Makes a folder and those it is in, and takes away what it made where the block fails."""
    made, missing = [], path
    while not missing.is_dir():
        made.append(missing)
        missing = missing.parent
    try:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StrataError(f"cannot make the folder {path}: {error.strerror or error}") from None
        yield
    except BaseException:
        for folder in made:
            with suppress(OSError):  # not there, or another wrote into it meanwhile
                folder.rmdir()
        raise


@contextmanager
def replaced(path: str | Path) -> Iterator[BinaryIO]:
    """A binary stream whose bytes become `path` when the block ends well; otherwise nothing changes. Missing
    folders are made.

    Written beside the target (so that the rename stays on one file system), synced, then renamed over it.
    Raises StrataError where the disk does not play along; any other exception, an interrupt too, passes
    through after the unfinished file is removed.
    """
    check_writable(path)
    path = Path(os.path.realpath(path))  # a symbolic link keeps pointing, its target is replaced
    unfinished = path.with_name(f".strata-{secrets.token_hex(6)}.part")
    with _folder(path.parent):
        try:
            with open(unfinished, "xb") as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(unfinished, path)
        except OSError as error:
            raise StrataError(f"cannot write {path}: {error.strerror or error}") from None
        finally:
            with suppress(OSError):
                unfinished.unlink()
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Makes the rename itself outlast a power cut; Windows cannot open folders, and needs no such thing."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
