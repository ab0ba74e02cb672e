"""The twelve cells: a fraction of all, balanced as its table says."""

from collections import Counter
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from adrl.imitation import Demonstrations, collect
from adrl.regret.cells import CELLS
from adrl.rewards import RewardConfig
from adrl.runs import Run

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
    assert config.shares_compiled
    assert config.learner.max_seconds is None
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


@pytest.mark.parametrize("name", ["slow-dense-clutter-diffbot", "noisy-dense-clutter-jackal"])
def test_all_methods_of_a_seed_see_the_same_demonstrations(name: str, tmp_path: Path) -> None:
    config = replace(CELLS[name].comparison("adrl,rlpd", 10, tmp_path), task_pool=4, num_envs=8)

    def shown(method: str, seed: int) -> Demonstrations:
        run = Run.of(config.run(method, seed, tmp_path / method))
        env = run.make_env(8, randomize=True, task_priority=run.config.task_priority)
        return collect(env, 64, expert=run.expert, seed=run.learner.seed)

    first, second, other = shown("adrl", 1), shown("rlpd", 1), shown("rlpd", 2)
    assert np.array_equal(first.observation, second.observation)
    assert np.array_equal(first.action, second.action)
    assert not np.array_equal(second.action, other.action)
