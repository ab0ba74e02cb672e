"""The wings of the core include one way: what a lower one includes, a higher one does not provide."""

import re
from pathlib import Path

import pytest

CORE = Path(__file__).resolve().parents[2] / "core"
WINGS = ("", "world", "drive", "planning", "control", "sim", "bindings")
"""From the ground up; the ground itself, clones, random numbers and threads, stands beside them."""
NOT_CORE = {"portable", "tests"}
"""What is linked to a wheel alone, and what tests the core."""


def test_every_folder_of_the_core_is_a_wing() -> None:
    assert {path.name for path in CORE.iterdir() if path.is_dir()} == {*WINGS[1:], *NOT_CORE}


@pytest.mark.parametrize("level", range(len(WINGS)))
def test_a_wing_includes_no_higher_one(level: int) -> None:
    files = list((CORE / WINGS[level]).glob("*.?pp"))
    assert files
    for path in files:
        for included in re.findall(r'#include "([^"]+)"', path.read_text()):
            wing = included.rpartition("/")[0]
            beside = WINGS[level] == "bindings" and not wing
            assert beside or WINGS.index(wing) <= level, f"{path.name} includes {included}"
