"""Looking things up by name: first our literal table, then the entry points of installed packages."""

from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import Any

from adrl.errors import UnknownName


def look_up(kind: str, name: str, table: Mapping[str, Any]) -> Any:
    """The entry called name in table, or the object that an installed package offers under that name.

    A package offers objects through the kind's entry point group: "adrl.robots", "adrl.reward_terms". Our names win.
    Raises UnknownName, which lists what there is and the nearest name.
    """
    if name in table:
        return table[name]
    offered = {point.name: point for point in entry_points(group=f"adrl.{kind.replace(' ', '_')}s")}
    if name in offered:
        return offered[name].load()
    raise UnknownName(kind, name, [*table, *offered])
