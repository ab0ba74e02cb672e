"""Files of ROS parameters: the mappings in them, and what is in these, checked."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from adrl.descriptions.findings import Reading, Standing
from adrl.errors import ConfigError, FileError, brief
from adrl.yaml_files import Twice, read_yaml

Parameters = Mapping[str, Any]
NODE = "ros__parameters"
"""Below it are a node's parameters in ROS 2."""
SUBSTITUTION = re.compile(r"\$\(|<\w+>")
"""What a launch file fills in."""
MOST_DOTS = 8
"""In a key; one with more is no way to a parameter."""


class Section:
    """The parameters at a place of a file, and what they say."""

    def __init__(
        self, path: Path, where: tuple[str, ...], parameters: Parameters, parent: Parameters
    ) -> None:
        self.path, self.where, self.parameters, self.parent = path, where, parameters, parent
        self.reading = Reading()

    def place(self, name: str) -> str:
        """The file, and the way to a parameter in it."""
        way = ".".join(part for part in (*self.where, name) if part != NODE)
        return f"{self.path}: {brief(way)}"

    def add(self, field: str, value: Any, name: str, standing: Standing = Standing.SAID) -> None:
        """What a parameter says of a field; nothing where the value is None."""
        if value is not None:
            self.reading.add(field, value, self.place(name), standing)

    def get(self, name: str) -> Any:
        """A parameter; None where it is not there. Raises ConfigError for one that is there twice."""
        value = self.parameters.get(name)
        if isinstance(value, Twice):
            raise ConfigError(f"{self.place(name)} is {' and '.join(map(brief, value))}; leave one")
        return value

    def first(self, names: Sequence[str]) -> str | None:
        """The first of the names that is there."""
        return next((name for name in names if self.parameters.get(name) is not None), None)

    def number(self, name: str) -> float | None:
        """A parameter; None where it is not there, or is left to a launch file. Raises ConfigError."""
        return self._number(name, self.get(name))

    def _number(self, name: str, value: Any) -> float | None:
        if value is None or (isinstance(value, str) and self._left_open(name, value)):
            return None
        good = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9
        if not good:
            raise ConfigError(f"{self.place(name)} is {brief(repr(value))[:60]}; give a number")
        return float(value)

    def numbers(self, name: str) -> list[float | None]:
        """Up to three numbers of a list, None for those that are not there. Raises ConfigError."""
        value = self.get(name)
        if value is not None and not isinstance(value, list):
            raise ConfigError(f"{self.place(name)} is {brief(repr(value))[:60]}; give a list of numbers")
        found = [self._number(f"{name}[{i}]", part) for i, part in enumerate((value or [])[:3])]
        return found + [None] * (3 - len(found))

    def text(self, name: str) -> str | None:
        """A parameter that is a text; None where it is not there, empty, or left to a launch file."""
        value = self.get(name)
        return value if isinstance(value, str) and value and not self._left_open(name, value) else None

    def _left_open(self, name: str, value: str) -> bool:
        if SUBSTITUTION.search(value) is None:
            return False
        self.reading.notes.append(f"{self.place(name)} is {brief(value)[:60]}, which a launch file fills in")
        return True


def read_sections(path: Path) -> list[Section]:
    """All mappings of a file. Raises ConfigError."""
    try:
        content = read_yaml(path, keep_all=True)
    except FileError as error:
        raise ConfigError(f"{path} {error}; give Nav2's parameter file") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path} holds no parameters; give Nav2's parameter file")
    return [Section(path, *found) for found in _walk((), _nested(content, path), {})]


def _walk(
    where: tuple[str, ...], parameters: Parameters, parent: Parameters
) -> Iterator[tuple[tuple[str, ...], Parameters, Parameters]]:
    """The way to a mapping, itself and the one around it; then those in it."""
    yield where, parameters, parent
    for name, value in parameters.items():
        if isinstance(value, dict):
            yield from _walk((*where, name), value, parameters)


def _nested(content: Parameters, path: Path) -> dict[str, Any]:
    """With a.b written out as b in a, as ROS 2 reads it. Raises ConfigError for what is then there twice."""
    nested: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, Twice) and any(isinstance(each, dict) for each in value):
            raise ConfigError(f"{path} has {brief(key)!r} twice; leave one")
        if isinstance(value, dict):
            value = _nested(value, path)
        *outer, last = str(key).split(".") if str(key).count(".") < MOST_DOTS else [str(key)]
        place = nested
        for name in outer:
            place = place.setdefault(name, {})
            if not isinstance(place, dict):
                raise ConfigError(f"{path} has {brief(key)!r} and a value for {name!r}; leave one")
        if isinstance(value, dict) and isinstance(place.get(last), dict):
            value = place[last] | value
        elif last in place:
            raise ConfigError(f"{path} has {brief(key)!r} twice; leave one")
        place[last] = value
    return nested
