"""The cellular automaton and its fields."""

import dataclasses
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest

from adrl.errors import NoPath, TaskError
from adrl.types import SPLITS
from adrl.worlds import FAMILIES, ROBOTS, load_sdf, task_set
from adrl.worlds.barn import field_task
from adrl.worlds.cellular import Cellular, have_way_through, margin_cells, smooth

JACKAL = ROBOTS["jackal"]
CELLULAR = Cellular()


def slow_smooth(filled: np.ndarray) -> np.ndarray:
    """The rule, cell by cell."""
    rows, columns = filled.shape
    out = filled.copy()
    for r in range(rows):
        for c in range(columns):
            count = 0
            for i in (r - 1, r, r + 1):
                for j in (c - 1, c, c + 1):
                    if (i, j) == (r, c):
                        continue
                    if j < 0 or j >= columns:
                        count += 1
                    elif 0 <= i < rows:
                        count += int(filled[i, j])
            if count >= 5:
                out[r, c] = True
            elif count <= 1:
                out[r, c] = False
    return out


def slow_way_through(filled: np.ndarray, margin: int) -> bool:
    """Flood from the first row, cell by cell."""
    rows, columns = filled.shape

    def is_open(r: int, c: int) -> bool:
        window = filled[max(r - margin, 0) : r + margin + 1, max(c - margin, 0) : c + margin + 1]
        return not window.any()

    todo = [(0, c) for c in range(columns) if is_open(0, c)]
    seen = set(todo)
    while todo:
        r, c = todo.pop()
        if r == rows - 1:
            return True
        for i, j in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
            if 0 <= i < rows and 0 <= j < columns and (i, j) not in seen and is_open(i, j):
                seen.add((i, j))
                todo.append((i, j))
    return False


def test_smoothing_follows_the_rule() -> None:
    fields = np.random.default_rng(0).random((6, 9, 12)) < np.linspace(0.1, 0.6, 6)[:, None, None]
    np.testing.assert_array_equal(smooth(fields), [slow_smooth(field) for field in fields])


def test_mirrored_fields_smooth_to_mirrored_ones() -> None:
    field = np.random.default_rng(1).random((30, 30)) < 0.3
    np.testing.assert_array_equal(smooth(field[:, ::-1]), smooth(field)[:, ::-1])


@pytest.mark.parametrize("margin", [0, 1, 2])
def test_ways_through_are_those_of_a_flood(margin: int) -> None:
    fields = np.random.default_rng(2).random((40, 12, 14)) < np.linspace(0.02, 0.4, 40)[:, None, None]
    expected = [slow_way_through(field, margin) for field in fields]
    assert 0 < sum(expected) < 40
    np.testing.assert_array_equal(have_way_through(fields, margin), expected)


def test_a_jackal_needs_five_cells_as_in_the_benchmark() -> None:
    assert margin_cells(JACKAL) == 2
    assert margin_cells(ROBOTS["turtlebot3_burger"]) == 1


@pytest.mark.slow
def test_fields_are_as_dense_as_the_benchmarks(barn: Path) -> None:
    theirs = [len(load_sdf(file).circles) for file in (barn / "worlds").glob("*.world")]
    ours = [len(task.world.circles) for task in task_set(CELLULAR, JACKAL, "test", 150)]
    assert np.mean(ours) == pytest.approx(np.mean(theirs), rel=0.08)
    assert np.std(ours) == pytest.approx(np.std(theirs), rel=0.3)


def test_more_fill_means_more_cylinders() -> None:
    means = [
        np.mean([len(task.world.circles) for task in task_set(Cellular(fill=(f, f)), JACKAL, "train", 10)])
        for f in (0.1, 0.2, 0.28)
    ]
    assert means == sorted(means)


def test_fields_of_the_splits_are_all_different() -> None:
    tasks = [
        task for split in ("train", "validation", "test") for task in task_set(CELLULAR, JACKAL, split, 20)
    ]
    assert len({task.world.circles.tobytes() for task in tasks}) == len(tasks)


def test_a_robot_too_large_is_told_so() -> None:
    wide = dataclasses.replace(JACKAL, name="wide", footprint_m=None, radius_m=2.2)
    with pytest.raises(TaskError, match="wide"):
        task_set(CELLULAR, wide, "train", 1)


@pytest.mark.slow
def test_a_car_has_a_task_where_the_first_field_has_no_curves_for_it() -> None:
    """Robot 662 finds none in field 662: training with a family has ended over that."""
    car = FAMILIES["any"].draw("train", 662)
    assert car.is_car
    (task,) = task_set(CELLULAR, car, "train", 1, first=662)
    seed = np.random.SeedSequence(crc32(b"cellular"), spawn_key=(SPLITS.index("train"), 662))
    first = CELLULAR.generate(np.random.default_rng(seed), car)
    assert task.world.circles.tobytes() != first.circles.tobytes()
    with pytest.raises(NoPath, match="any:train:662"):
        field_task(first, car)


def test_the_corridor_is_the_benchmarks(barn: Path) -> None:
    """All of a world below its field is the same in both."""
    ours = CELLULAR.task(np.random.default_rng(0), JACKAL).world.circles
    theirs = load_sdf(barn / "worlds" / "world_18.world").circles
    mine, given = (np.sort(circles[circles[:, 1] < 5.1].round(6), axis=0) for circles in (ours, theirs))
    np.testing.assert_array_equal(mine, given)
