"""What to do about a bag that cannot be read: what stands in its place, and what mends it."""

from pathlib import Path

from adrl.errors import DatasetError

STORAGE = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
"""Endings of the files in the folder of a ROS 2 bag."""
METADATA = "metadata.yaml"
"""What a recorder writes into it last."""


def require_bag(path: Path) -> None:
    """Raises DatasetError where no whole bag can be: nothing there, a folder without one, a recorder was killed."""
    if not path.exists():
        raise DatasetError(f"{path}: no such file; give a ROS 1 bag, or the folder of a ROS 2 bag")
    if path.name.endswith((".bag.active", ".orig.bag.active")):
        raise DatasetError(
            f"{path}: rosbag has not finished it; if it no longer records, run: rosbag reindex {path}, and give what "
            f"that makes as a file .bag"
        )
    if path.is_dir():
        _require_whole_folder(path)
    elif path.is_file() and path.stat().st_size == 0:
        raise DatasetError(f"{path}: not a readable bag: the file is empty; record it again")
    elif not path.is_file():
        raise DatasetError(f"{path}: no ordinary file; give a ROS 1 bag, or the folder of a ROS 2 bag")
    elif path.name == METADATA:
        raise DatasetError(f"{path}: a bag of ROS 2 is the folder of this file; give {path.parent}")
    elif path.name.endswith(".zstd"):
        raise DatasetError(
            f"{path}: a compressed file of a ROS 2 bag; give the folder that has its {METADATA}"
        )
    elif path.suffix not in (".bag", ".mcap", ".db3"):
        raise DatasetError(f"{path}: not a readable bag: give a file .bag, or the folder of a ROS 2 bag")


def _require_whole_folder(path: Path) -> None:
    if (path / METADATA).is_file():
        empty = [
            file.name for file in path.iterdir() if file.name.endswith(STORAGE) and file.stat().st_size == 0
        ]
        if empty:
            raise DatasetError(
                f"{path}: not a readable bag: {', '.join(sorted(empty))} is empty; record it again"
            )
        return
    files = sorted(file.name for file in path.iterdir())
    if any(name.endswith(STORAGE) for name in files):
        raise DatasetError(
            f"{path}: no {METADATA}, as when a recorder was killed; run: ros2 bag reindex {path}"
        )
    bags = [name for name in files if name.endswith(".bag")]
    inner = [name for name in files if (path / name / METADATA).is_file()]
    if bags or inner:
        raise DatasetError(f"{path}: a folder of bags; give the bags in it: {', '.join((bags + inner)[:8])}")
    raise DatasetError(
        f"{path}: a folder without a bag: neither {METADATA} nor files .mcap or .db3 are in it; give the one that "
        "ros2 bag record made"
    )


def reason(error: Exception) -> str:
    """What a library's error says; its kind where it says nothing."""
    text = " ".join(str(part) for part in error.args).replace("; please report issue", "")
    return text.strip().rstrip(".") or type(error).__name__


def mending(path: Path, error: Exception) -> str:
    """What to run, to be put behind the reason; "" where nothing is known to help."""
    text = f"{type(error).__name__} {error}".lower()
    stored = {file.suffix for file in path.iterdir()} if path.is_dir() else {path.suffix}
    for words, found, advice in _MENDINGS:
        if found in stored and any(word in text for word in words):
            return f"; {advice.format(path=path)}"
    return ""


_REINDEX = "run: ros2 bag reindex {path}"
_MENDINGS = (
    (("is unknown",), ".bag", "its messages are of an old release; run: rosbag fix {path} NEW.bag"),
    # rosbags takes the index in one layout only, and says no word of another.
    (
        ("assertion",),
        ".bag",
        "run: rosbag reindex {path}, or if that does not help: rosbag filter {path} NEW.bag True",
    ),
    (("index", "header", "uint", "got only", "record"), ".bag", "run: rosbag reindex {path}"),
    (("not a database", "malformed"), ".mcap", f"{METADATA} names another storage than .mcap; {_REINDEX}"),
    (("magic",), ".db3", f"{METADATA} names another storage than .db3; {_REINDEX}"),
    (("some database files are missing",), ".yaml", f"put them back, or {_REINDEX}"),
    (("storage plugin", "version"), ".yaml", "convert it: ros2 bag convert"),
    (
        ("magic", "truncated", "footer"),
        ".mcap",
        "if its end was lost, run: mcap recover FILE.mcap -o NEW.mcap",
    ),
    (("not a database", "malformed"), ".db3", "if its end was lost, run: sqlite3 FILE.db3 .recover"),
    (("metadata", "yaml"), ".yaml", _REINDEX),
)
"""Words of rosbags' errors, the ending of a file that is there, and what helps then; the first that fits."""
