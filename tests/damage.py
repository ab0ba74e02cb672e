"""What may have become of a file that was written whole."""

from pathlib import Path

DAMAGES = ("cut", "empty", "foreign", "missing")


def damage_file(path: Path, damage: str) -> None:
    """Do this to the file: its end cut off, all of it gone, another program's content, or no file any more."""
    if damage == "missing":
        path.unlink()
        return
    whole = path.read_bytes()
    path.write_bytes({"cut": whole[:-3], "empty": b"", "foreign": b"PK\x03\x04" + 99 * b"\xff"}[damage])
