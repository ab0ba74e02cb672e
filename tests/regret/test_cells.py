"""The twelve cells: a fraction of all, balanced as its table says."""

from collections import Counter
from itertools import combinations
from pathlib import Path

import pytest

from adrl.regret.cells import CELLS
from adrl.rewards import RewardConfig

FACTORS = ("reward", "place", "robot")


def test_every_level_appears_as_often() -> None:
    cells = list(CELLS.values())
    assert len(cells) >= 12
    assert set(Counter(cell.expert for cell in cells).values()) == {2}
    for factor in FACTORS:
        assert set(Counter(getattr(cell, factor) for cell in cells).values()) == {len(cells) // 2}


def test_each_expert_meets_every_level() -> None:
    for expert in {cell.expert for cell in CELLS.values()}:
        first, second = (cell for cell in CELLS.values() if cell.expert == expert)
        assert all(getattr(first, factor) != getattr(second, factor) for factor in FACTORS)


def test_no_two_factors_go_together() -> None:
    for a, b in combinations(FACTORS, 2):
        pairs = Counter((getattr(cell, a), getattr(cell, b)) for cell in CELLS.values())
        assert len(pairs) == 4
        assert max(pairs.values()) <= 4


@pytest.mark.parametrize("name", CELLS)
def test_a_cell_is_the_comparison_that_it_says(name: str) -> None:
    cell = CELLS[name]
    config = cell.comparison("adrl,td3", 10, Path("out"))
    assert 20_000 <= cell.steps <= 131_072
    assert (config.learner.steps, config.robot, config.load().name) == (cell.steps, cell.robot, cell.place)
    assert str(config.expert) == cell.expert
    assert config.out == Path("out") / name
    assert config.learner.reward == RewardConfig(
        extra_terms=("no-approach",) if cell.reward == "terminal" else ()
    )
    assert config.method_names == ("adrl", "td3")


def test_all_methods_of_a_cell_differ_in_themselves_alone() -> None:
    for cell in CELLS.values():
        config = cell.comparison("adrl,td3bc", 10, Path("out"))
        runs = [config.run(method, 3, Path("run")) for method in config.method_names]
        assert runs[0].learner == runs[1].learner
        assert runs[0].learner.seed == 3
