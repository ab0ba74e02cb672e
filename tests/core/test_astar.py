"""A* against Dijkstra and the published optima, and paths pulled taut."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from adrl import _core
from adrl.types import Array
from core import twins
from core.twins import Cell

Bitmap = NDArray[np.uint8]
shapes = st.tuples(st.integers(1, 18), st.integers(1, 18))
bitmaps = hnp.arrays(np.uint8, shapes, elements=st.sampled_from([0, 0, 1]))


def random_bitmap(seed: int, height: int = 40, width: int = 50) -> Bitmap:
    """Scattered cells and some walls."""
    rng = np.random.default_rng(seed)
    blocked = (rng.random((height, width)) < 0.12).astype(np.uint8)
    for _ in range(6):
        row, column = rng.integers(height), rng.integers(width)
        blocked[row, column : column + 15] = 1
        blocked[row : row + 12, column] = 1
    return blocked


def octile_m(cells: NDArray[np.int32]) -> float:
    """Length of a path of cells."""
    return float(np.hypot(*np.diff(cells, axis=0).T).sum())


def assert_is_a_legal_path(blocked: Bitmap, cells: NDArray[np.int32], start: Cell, goal: Cell) -> None:
    assert cells.dtype == np.int32
    path = [(int(row), int(column)) for row, column in cells]
    assert (path[0], path[-1]) == (start, goal)
    for here, after in pairwise(path):
        assert after in dict(twins.moves(blocked, here))


@given(bitmaps, st.data())
def test_the_length_is_dijkstras(blocked: Bitmap, data: st.DataObject):
    height, width = blocked.shape
    some_cell = st.tuples(st.integers(0, height - 1), st.integers(0, width - 1))
    start, goal = data.draw(some_cell), data.draw(some_cell)
    reached = twins.dijkstra(blocked, start)
    cells, length = _core.astar(blocked, start, goal)
    if goal not in reached:
        assert cells.shape == (0, 2)
        assert length == math.inf
        return
    assert_allclose(length, reached[goal], atol=1e-9)
    assert_allclose(octile_m(cells), length, atol=1e-9)
    assert_is_a_legal_path(blocked, cells, start, goal)


@pytest.mark.parametrize("seed", range(8))
def test_the_length_is_dijkstras_from_one_cell_to_all_others(seed: int):
    blocked = random_bitmap(seed)
    start = tuple(int(i) for i in np.argwhere(blocked == 0)[seed * 31])
    reached = twins.dijkstra(blocked, (start[0], start[1]))
    for goal in np.ndindex(blocked.shape):
        if (goal[0] + goal[1]) % 5 == 0:
            length = _core.astar(blocked, (start[0], start[1]), (goal[0], goal[1]))[1]
            assert_allclose(length, reached.get((goal[0], goal[1]), math.inf), atol=1e-9)


@given(bitmaps, st.data())
def test_there_and_back_are_equally_long(blocked: Bitmap, data: st.DataObject):
    height, width = blocked.shape
    some_cell = st.tuples(st.integers(0, height - 1), st.integers(0, width - 1))
    start, goal = data.draw(some_cell), data.draw(some_cell)
    assert_allclose(_core.astar(blocked, start, goal)[1], _core.astar(blocked, goal, start)[1])


def test_corners_are_not_cut_and_diagonal_gaps_are_shut():
    gap = np.array([[0, 1], [1, 0]], dtype=np.uint8)
    assert _core.astar(gap, (0, 0), (1, 1))[1] == math.inf
    corner = np.array([[0, 0], [1, 0]], dtype=np.uint8)
    assert _core.astar(corner, (0, 0), (1, 1))[1] == 2.0
    assert _core.astar(np.zeros((2, 2), np.uint8), (0, 0), (1, 1))[1] == math.sqrt(2.0)


@pytest.mark.parametrize("outside", [(-1, 0), (0, -1), (3, 0), (0, 4), (2**31 - 1, 0)])
def test_ends_that_are_blocked_or_outside_have_no_path(outside: Cell):
    free = np.zeros((3, 4), dtype=np.uint8)
    assert_array_equal(_core.astar(free, (1, 1), (1, 1))[0], [[1, 1]])
    for start, goal in (((1, 1), outside), (outside, (1, 1))):
        cells, length = _core.astar(free, start, goal)
        assert cells.shape == (0, 2)
        assert length == math.inf
    free[0, 0] = 1
    assert _core.astar(free, (0, 0), (1, 1))[1] == _core.astar(free, (1, 1), (0, 0))[1] == math.inf


def read_movingai(folder: Path, city: str) -> tuple[Bitmap, list[tuple[Cell, Cell, float]]]:
    """A benchmark map and its scenarios: start, goal, optimal length."""
    rows = (folder / f"{city}.map").read_text().splitlines()[4:]
    blocked = np.array([[cell not in ".G" for cell in row] for row in rows], dtype=np.uint8)
    scenarios = []
    for line in (folder / f"{city}.map.scen").read_text().splitlines()[1:]:
        fields = line.split("\t")
        start_x, start_y, goal_x, goal_y = (int(number) for number in fields[4:8])
        scenarios.append(((start_y, start_x), (goal_y, goal_x), float(fields[8])))
    return blocked, scenarios


@pytest.mark.parametrize("city", ["Berlin_0_256", "Boston_1_256"])
def test_every_published_optimum(cities: Path, city: str):
    blocked, scenarios = read_movingai(cities, city)
    assert len(scenarios) >= 900
    for start, goal, optimum in scenarios:
        cells, length = _core.astar(blocked, start, goal)
        assert_allclose(length, optimum, atol=1e-6, err_msg=f"{city}: {start} to {goal}")
        assert_allclose(octile_m(cells), optimum, atol=1e-6)


# --- pulled taut --------------------------------------------------------------------------------


def touched(at: Array) -> list[Cell]:
    """Cells whose closed square holds a point; more than one on a border."""
    choices = [{math.floor(x + 0.5 - 1e-7), math.floor(x + 0.5 + 1e-7)} for x in at]
    return [(row, column) for row in choices[0] for column in choices[1]]


def assert_line_is_free(blocked: Bitmap, a: Array, b: Array) -> None:
    """Sampled every hundredth of a cell. A point on a border is free when a cell beside it is."""
    count = max(2, int(100 * np.hypot(*(b - a))))
    for u in np.linspace(0.0, 1.0, count):
        cells = touched(a + u * (b - a))
        assert any(blocked[cell] == 0 for cell in cells), f"{a} to {b} crosses {cells}"


def assert_is_pulled_taut(blocked: Bitmap, cells: NDArray[np.int32]) -> None:
    corners = _core.shorten_path(blocked, cells)
    assert_array_equal(corners[[0, -1]], cells[[0, -1]])
    length = float(np.hypot(*np.diff(corners, axis=0).T).sum())
    assert math.dist(corners[0], corners[-1]) - 1e-9 <= length <= octile_m(cells) + 1e-9
    for a, b in pairwise(corners):
        assert_line_is_free(blocked, a, b)


@given(bitmaps, st.data())
def test_shortened_paths_keep_their_ends_stay_free_and_are_never_longer(blocked: Bitmap, data: st.DataObject):
    free = np.argwhere(blocked == 0)
    if len(free) < 2:
        return
    ends = [tuple(int(i) for i in free[data.draw(st.integers(0, len(free) - 1))]) for _ in range(2)]
    cells, length = _core.astar(blocked, (ends[0][0], ends[0][1]), (ends[1][0], ends[1][1]))
    if length < math.inf:
        assert_is_pulled_taut(blocked, cells)


@pytest.mark.parametrize("city", ["Berlin_0_256", "Boston_1_256"])
def test_long_paths_through_cities_are_pulled_taut(cities: Path, city: str):
    blocked, scenarios = read_movingai(cities, city)
    for start, goal, _ in scenarios[::180]:
        assert_is_pulled_taut(blocked, _core.astar(blocked, start, goal)[0])


def test_a_path_in_the_open_becomes_a_straight_line():
    free = np.zeros((30, 40), dtype=np.uint8)
    for goal in ((29, 39), (29, 0), (13, 39), (0, 20)):
        cells = _core.astar(free, (2, 1), goal)[0]
        assert_array_equal(_core.shorten_path(free, cells), [(2, 1), goal])


def test_a_path_round_a_corner_bends_at_the_corner_only():
    blocked = np.zeros((21, 21), dtype=np.uint8)
    blocked[:15, 10] = 1
    corners = _core.shorten_path(blocked, _core.astar(blocked, (2, 2), (2, 18))[0])
    length = float(np.hypot(*np.diff(corners, axis=0).T).sum())
    # Around the wall's end, whose free corners are (14.5, 9.5) and (14.5, 10.5).
    tightest = 2.0 * math.dist((2, 2), (14.5, 9.5)) + 1.0
    assert tightest - 1e-9 <= length <= tightest + 0.5


@pytest.mark.parametrize("count", [0, 1, 2])
def test_paths_too_short_to_shorten_stay(count: int):
    cells = np.array([[1, 1], [2, 2]], dtype=np.int32)[:count]
    assert_array_equal(_core.shorten_path(np.zeros((4, 4), np.uint8), cells), cells)
