"""Where the files are that a world names: models of <include>, meshes."""

import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element

from adrl.errors import WorldError
from adrl.worlds.sdf.document import parse, root_of

PATH_VARIABLES = (
    "GAZEBO_MODEL_PATH",
    "GZ_SIM_RESOURCE_PATH",
    "IGN_GAZEBO_RESOURCE_PATH",
    "SDF_PATH",
    "GAZEBO_RESOURCE_PATH",
)
PACKAGE_VARIABLES = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH")
LEVELS = 4
"""Folders that are looked in, from the file's own upwards: as deep as worlds lie in packages of ROS;"""
BESIDE = ("", "models", "Media/models")
"""and in each of them these."""
TOP_LEVEL = ("model", "actor", "light")
HINT = "give the folder of its models with --models"


@dataclass(frozen=True)
class Library:
    """Finds what an address names. Looked in, in this order: folders, the variables of Gazebo, and beside the file:
    its folder and those above it, in each `models` too; the folder where Gazebo keeps its own.
    """

    folders: tuple[Path, ...] = ()
    _files: dict[Path, Element] = field(default_factory=dict)

    @classmethod
    def of(cls, models: Sequence[str | os.PathLike[str]]) -> "Library":
        """models: folders, or lists of them as in PATH. Raises WorldError for one that is none."""
        folders = [Path(part) for entry in models for part in os.fspath(entry).split(os.pathsep) if part]
        for folder in folders:
            if not folder.is_dir():
                raise WorldError(f"is to be read with --models {folder}, which is no folder")
        return cls(tuple(folders))

    def find(self, uri: str, folder: Path, accept: Callable[[Path], bool] = Path.is_file) -> Path:
        """The first acceptable place that an address, named in a file of this folder, may mean. Raises WorldError."""
        scheme, separator, rest = uri.partition("://")
        if not separator:
            scheme, rest = "", uri
        parts = [part for part in rest.split("/") if part not in ("", ".")]
        if not parts or "\0" in uri:
            raise WorldError(f"has the address {uri!r}, which names nothing; correct its <uri>")
        for place in self._places(scheme, rest, parts, folder):
            try:
                if accept(place):
                    return place
            except OSError:  # a name too long, a folder that may not be entered
                continue
        raise WorldError(f"needs {uri}, which is in none of the folders; {HINT}")

    def _places(self, scheme: str, rest: str, parts: list[str], folder: Path) -> Iterator[Path]:
        inside = Path(*parts)
        if scheme in ("", "file"):
            yield from (folder / rest, Path(rest) if rest.startswith("/") else folder / inside)
        if scheme in ("http", "https"):
            yield from _fuel_cache(parts)
            # As people keep what they download: in a folder of the model's name.
            at = next((i for i, part in enumerate(parts) if part.lower() == "models"), len(parts) - 2)
            inside = Path(*[unquote(part) for part in parts[at + 1 :]])
        for place in self._folders(folder):
            yield place / inside
        if scheme in ("package", "model"):
            yield from _packages(parts)

    def _folders(self, folder: Path) -> Iterator[Path]:
        yield from self.folders
        yield from _listed(PATH_VARIABLES)
        place = folder.absolute()
        for _ in range(LEVELS):
            yield from (place / name for name in BESIDE)
            place = place.parent
        yield Path.home() / ".gazebo" / "models"

    def model(self, uri: str, folder: Path) -> tuple[Element, Path]:
        """The <model>, <actor> or <light> of an <include>, and its folder. Raises WorldError."""
        file = _model_file(self.find(uri, folder, lambda place: _model_file(place).is_file()))
        try:
            if file not in self._files:
                root = parse(file)
                found = [element for tag in TOP_LEVEL if (element := root.find(tag)) is not None]
                self._files[file] = found[0] if found else root_of(file, "model")
            return self._files[file], file.parent
        except WorldError as error:
            raise WorldError(f"needs {uri}, but {file} {error}") from None


def _model_file(place: Path) -> Path:
    """The file itself, or of a folder the newest <sdf> that model.config lists; else model.sdf, or the only .sdf."""
    config = place / "model.config"
    if not place.is_dir():
        return place
    if config.is_file():
        try:
            listed = [
                (_version(e.get("version", "0")), (e.text or "").strip()) for e in parse(config).iter("sdf")
            ]
        except WorldError:  # Gazebo minds less what else is in it
            listed = []
        if named := [entry for entry in listed if entry[1]]:
            return place / max(named)[1]
    found = sorted(place.glob("*.sdf"))
    return found[0] if len(found) == 1 else place / "model.sdf"


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d{1,6}", text))


def _listed(variables: Sequence[str]) -> Iterator[Path]:
    for variable in variables:
        yield from (Path(part) for part in os.environ.get(variable, "").split(os.pathsep) if part)


def _packages(parts: list[str]) -> Iterator[Path]:
    """Of packages of ROS, by name."""
    for place in _listed(PACKAGE_VARIABLES):
        yield from (place / "share" / Path(*parts), place / Path(*parts), place.parent / Path(*parts))


def _fuel_cache(parts: list[str]) -> Iterator[Path]:
    """server/1.0/owner/models/name/version/files... as Gazebo keeps what it downloaded, the newest version."""
    if len(parts) < 5:
        return
    server, owner, kind, name, *rest = parts[0], *parts[2:]
    rest = [part for part in rest if part != "files"]
    version = rest.pop(0) if rest and (rest[0].isdigit() or rest[0] == "tip") else ""
    roots = [*_listed(("GZ_FUEL_CACHE_PATH", "IGN_FUEL_CACHE_PATH"))]
    roots += [Path.home() / ".gz" / "fuel", Path.home() / ".ignition" / "fuel"]
    for root in roots:
        place = root / server / unquote(owner).lower() / kind.lower() / unquote(name).lower()
        versions = sorted((int(p.name) for p in place.glob("*") if p.name.isdigit()), reverse=True)
        wanted = [int(version)] if version.isdigit() else versions[:1]
        yield from (Path(place, str(number), *map(unquote, rest)) for number in wanted)
