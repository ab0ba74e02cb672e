"""Looking things up by name: first our literal table, then the entry points of installed packages."""

from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from adrl.errors import ConfigError, UnknownName


def look_up(kind: str, name: str, table: Mapping[str, Any]) -> Any:
    """The entry called name in table, or the object that an installed package offers under that name.

    A package offers objects through the kind's entry point group: "adrl.robots", "adrl.reward_terms". Our names win.
    Raises UnknownName, which lists what there is and the nearest name.
    """
    if name in table:
        return table[name]
    found = offered(kind)
    if name in found:
        return found[name].load()
    raise UnknownName(kind, name, [*table, *found])


def listed(text: str) -> tuple[str, ...]:
    """The names in a text with commas between, each once."""
    return tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))


def listed_option(option: str, text: str) -> tuple[str, ...]:
    """The same of an option that has to name something. Raises ConfigError."""
    if names := listed(text):
        return names
    raise ConfigError(
        f"{option} is {text!r}, which names nothing; give names with commas between, or leave it out"
    )


def offered(kind: str) -> dict[str, EntryPoint]:
    """What installed packages offer of a kind: name -> entry point. Nothing of it is imported."""
    plural = f"{kind[:-1]}ies" if kind.endswith("y") else f"{kind}s"
    points = entry_points(group=f"adrl.{plural.replace(' ', '_')}")
    return {point.name: point for point in sorted(points, key=lambda point: point.name)}
