"""Files: written so that a reader sees the old content or the new one, read only where they are ordinary and small."""

import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

from adrl.errors import FileError


def read_bytes(path: str | os.PathLike[str], most_bytes: int) -> bytes:
    """The content of an ordinary file of at most so many bytes: a device or a pipe may never end.

    Raises FileError.
    """
    try:
        # Without waiting: a pipe opens only when somebody writes to it.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except FileNotFoundError:
        raise FileError("does not exist") from None
    except (OSError, ValueError) as error:
        raise FileError(f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise FileError("cannot be read: it is no ordinary file")
        with open(descriptor, "rb", closefd=False) as stream:
            content = stream.read(most_bytes + 1)
    except OSError as error:
        raise FileError(f"cannot be read: {error.strerror}") from None
    finally:
        os.close(descriptor)
    if len(content) > most_bytes:
        raise FileError(f"is larger than {most_bytes / 2**20:g} MiB")
    return content


def require_ordinary(path: str | os.PathLike[str]) -> None:
    """For a file that a library opens by itself: it exists, and is no device, pipe or folder. Raises FileError."""
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        raise FileError("does not exist") from None
    except (OSError, ValueError) as error:
        raise FileError(f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(mode):
        raise FileError("cannot be read: it is no ordinary file")


def read_text(path: str | os.PathLike[str], most_bytes: int) -> str:
    """The same of a text in UTF-8, with or without a byte order mark. Raises FileError."""
    try:
        return read_bytes(path, most_bytes).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FileError("cannot be read: it is no text in UTF-8") from None


def atomic_write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write data to path at once: a temporary name in the same folder, fsync, rename.

    Missing folders are made. A symbolic link keeps pointing where it did and its target is replaced. A path
    that is not a regular file, such as /dev/stdout, is written to directly. Raises OSError; path is then
    untouched.
    """
    target = Path(os.path.realpath(path))
    if _is_special(path):
        with open(path, "wb") as stream:
            stream.write(data)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.name[:200]}.{uuid4().hex}.tmp")
    try:
        # 0o666 less the umask, as for any new file; "x" so that no other writer's file is taken.
        with open(temporary, "xb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync(target.parent)


def atomic_write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write text as UTF-8 with the guarantees of atomic_write_bytes."""
    atomic_write_bytes(path, text.encode("utf-8"))


def to_json(content: Mapping[str, Any]) -> str:
    """Strict JSON, keys in the order given. Raises ValueError on NaN or infinity: JSON has none."""
    return json.dumps(content, indent=2, allow_nan=False)


def write_json(path: str | os.PathLike[str], content: Mapping[str, Any]) -> None:
    """Write to_json(content)."""
    atomic_write_text(path, to_json(content) + "\n")


def _is_special(path: str | os.PathLike[str]) -> bool:
    """Whether path exists and is a device, pipe or socket."""
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def sync(path: str | os.PathLike[str]) -> None:
    """Make what was written to a file, or renamed in a folder, last through a power cut."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
