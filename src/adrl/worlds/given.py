"""Given worlds, told apart by what stands in them: a score says which of its worlds training had."""

from collections.abc import Sequence
from hashlib import sha256
from typing import Protocol, runtime_checkable

import numpy as np

from adrl.types import Array, Scenario, World

GIVEN = ("barn:", "sdf:")
"""How the names of such scenarios begin."""


@runtime_checkable
class GivenWorlds(Protocol):
    """A scenario in worlds that were given, not drawn."""

    @property
    def training_worlds(self) -> Sequence[World]:
        """Those of its training split."""
        ...


def fingerprint(world: World) -> str:
    """The same for the same things to the millimetre, wherever the file lies, whatever it is called, in any order."""
    circles, segments, *polygons = (
        _in_millimetres(p) for p in (world.circles, world.segments, *world.polygons)
    )
    return sha256(b"".join((circles, segments, *sorted(polygons)))).hexdigest()[:16]


def _in_millimetres(part: Array) -> bytes:
    """Its rows, in an order of their own."""
    rows = np.rint(1000.0 * part).astype("<i8")
    return f"{rows.shape}".encode() + rows[np.lexsort(rows.T)].tobytes()


def training_fingerprints(scenario: Scenario) -> set[str]:
    """Of the given worlds that training in a scenario has; none where each is drawn anew."""
    return {fingerprint(w) for w in scenario.training_worlds} if isinstance(scenario, GivenWorlds) else set()
