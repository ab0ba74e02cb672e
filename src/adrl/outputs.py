"""Where results go, checked before the work that makes them: a place that cannot be written loses nothing."""

import fcntl
import os
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from adrl.errors import ConfigError

PathLike = str | os.PathLike[str]
LOCK_FILE = ".lock"


def as_paths(config: object, *names: str) -> None:
    """Fields of a frozen dataclass that were given as texts become paths; None stays."""
    for name in names:
        value = getattr(config, name)
        if value is not None:
            object.__setattr__(config, name, Path(value))


def require_folder(option: str, path: PathLike | None, *marks: str, parts: Collection[str] = ()) -> None:
    """Files can be written to a folder at path, which may not exist yet. Nothing stays of the attempt.

    marks: names of files, one of which stands in a folder of this kind; one that holds anything else is not written
    to. parts: what a writer that was killed before it made its mark may have left. Raises ConfigError.
    """
    if path is None:
        return
    folder = Path(path).absolute()
    existing = _nearest(folder)
    if not existing.is_dir():
        raise ConfigError(f"{option} {path}: {existing} is no folder; give another place")
    try:
        tempfile.TemporaryFile(
            dir=existing
        ).close()  # permissions alone promise too much: root has them in /proc
    except OSError:
        raise ConfigError(f"{option} {path}: {existing} cannot be written to; give another place") from None
    if marks and existing == folder and _holds_something_else(folder, marks, parts):
        raise ConfigError(f"{option} {path} holds files of something else; give another folder")


def require_file(option: str, path: PathLike | None) -> None:
    """The same of a file that is to be written at path; a file that is there is replaced. - is standard output."""
    if path is None or str(path) == "-":
        return
    file = Path(path).absolute()
    if file.is_dir():
        raise ConfigError(f"{option} {path} is a folder; give a file")
    if file.exists() and not os.access(file, os.W_OK):
        raise ConfigError(f"{option} {path} cannot be written to; give another file")
    if not file.exists() or file.is_file():  # no folder is needed beside a device or a pipe
        require_folder(option, Path(os.path.realpath(file)).parent)


@contextmanager
def locked(folder: PathLike) -> Iterator[None]:
    """One writer at a time in a folder, which is made; one in which nothing came to be is gone afterwards.

    The lock ends with the process, however that ends. Raises ConfigError while another holds it.
    """
    folder = Path(folder)
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    with _lock(folder) as lock:
        try:
            yield
        finally:
            Path(lock.name).unlink(missing_ok=True)
            with suppress(OSError):  # not empty
                for place in made:
                    place.rmdir()


def _lock(folder: Path) -> IO[str]:
    while True:
        lock = open(folder / LOCK_FILE, "a", encoding="ascii")  # noqa: SIM115
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(lock.fileno()), os.stat(lock.name)):
                return lock
        except BlockingIOError:
            lock.close()
            raise ConfigError(
                f"{folder} is being written to by another process; wait for its end, or give another folder"
            ) from None
        except FileNotFoundError:
            pass
        lock.close()  # its file went with the lock of before: make another


def _nearest(path: Path) -> Path:
    """The lowest of the path and the folders above it that exists; a link to nowhere does, for nothing fits there."""
    return next(place for place in (path, *path.parents) if place.exists() or place.is_symlink())


def _holds_something_else(folder: Path, marks: tuple[str, ...], parts: Collection[str]) -> bool:
    names = {entry.name for entry in folder.iterdir() if not entry.name.startswith(".")}
    return not names <= {*parts} and not any((folder / mark).exists() for mark in marks)
