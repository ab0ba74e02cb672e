"""The map a robot makes of its own scans, beside a slow twin."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from adrl import _core
from adrl.types import Array
from core.arenas import random_world
from core.replan_twins import HIGH, HIT, LOW, MISS, integrate, log_odds

SIDE, RES, BEAMS, RANGE = 120, 0.05, 90, 2.5
ANGLES: Array = -math.pi + 2.0 * math.pi / BEAMS * np.arange(BEAMS, dtype=np.float64)
ONE = np.ones(1, dtype=np.uint8)


def make_buffers(n: int = 1) -> dict[str, NDArray[Any]]:
    return {
        "kind": np.zeros(n, dtype=np.int64),
        "log_odds": np.zeros((n, SIDE, SIDE), dtype=np.int8),
        "origin": np.zeros((n, 2), dtype=np.int64),
        "parity": np.zeros(n, dtype=np.uint8),
        "waypoint": np.zeros((n, 2)),
        "route": np.zeros(n),
        "found": np.zeros(n, dtype=np.uint8),
    }


def make_native(
    buffers: dict[str, NDArray[Any]], body_radius_m: float = 0.01, **counts: int
) -> _core.Replanner:
    """counts: of the evidence, in the place of the usual ones."""
    evidence = _core.Evidence()
    for name, value in ({"hit": HIT, "miss": MISS, "low": LOW, "high": HIGH} | counts).items():
        setattr(evidence, name, value)
    setup = _core.ReplannerSetup(
        height=SIDE,
        width=SIDE,
        resolution_m=RES,
        evidence=evidence,
        beams=(BEAMS, -math.pi, 2.0 * math.pi / BEAMS),
        mount=(0.0, 0.0, 0.0),
        max_range_m=RANGE,
        reach_m=10.0,
        body_radius_m=body_radius_m,
        costs=_core.RouteCosts(),
        waypoint=_core.WaypointRules(),
    )
    n = len(buffers["origin"])
    return _core.Replanner(n, 1, [setup], buffers)


class Mapper:
    """One robot's map, native."""

    def __init__(
        self, pose: tuple[float, float, float] = (0.0, 0.0, 0.0), body_radius_m: float = 0.01
    ) -> None:
        self.b = make_buffers()
        self.native = make_native(self.b, body_radius_m)
        self.native.restart(ONE, np.array([pose]))

    @property
    def cells(self) -> NDArray[np.int8]:
        return self.b["log_odds"][0]

    def scan(self, ranges: Array, pose: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        self.native.observe(ONE, np.array([pose]), np.asarray(ranges, dtype=np.float32)[None])

    def at(self, x: float, y: float) -> int:
        row, column = np.floor(np.array([y, x]) / RES).astype(int) - self.b["origin"][0]
        return int(self.cells[row, column])

    def sees(self, x: float, y: float, *, known: bool = False) -> bool:
        out = np.zeros(1, dtype=np.uint8)
        self.native.see(ONE, np.zeros((1, 3)), np.array([[x, y]]), 100.0, known, out)
        return bool(out[0])


def wall_ahead(distance_m: float, beams: int = 5) -> Array:
    """A scan that sees something this far ahead with its middle beams, and nothing else."""
    ranges = np.full(BEAMS, RANGE)
    ranges[BEAMS // 2 - beams // 2 : BEAMS // 2 + beams // 2 + 1] = distance_m
    return ranges


def test_the_map_is_the_twins() -> None:
    """Three robots' drives through random worlds; the twin has no scratch, no clipping and no fixed point."""
    rng = np.random.default_rng(3)
    for _ in range(3):
        world = random_world(rng, 6)
        pose = np.array([0.313, -0.187, 0.4])
        mapper = Mapper(tuple(pose))
        slow = np.zeros((SIDE, SIDE), dtype=np.int8)
        for step in range(6):
            ranges = _core.raycast(world.native, pose[None], ANGLES, RANGE)
            mapper.scan(ranges[0], tuple(pose))
            row, column = (int(k) for k in mapper.b["origin"][0])
            integrate(slow, (row, column), RES, pose, ranges[0].astype(float), ANGLES, RANGE, step % 2)
            pose += [0.03, 0.02, 0.11]
        # A beam that passes a cell's corner may take either side of it.
        assert (mapper.cells != slow).mean() < 2e-3
        assert (mapper.cells == log_odds(HIGH)).sum() > 20


def test_a_moving_obstacle_is_seen_at_once_and_forgotten_in_ten_scans() -> None:
    mapper = Mapper()
    for _ in range(30):
        mapper.scan(np.full(BEAMS, RANGE))
    assert mapper.at(1.01, 0.01) == log_odds(LOW, once_free=True)
    mapper.scan(wall_ahead(1.0))
    assert mapper.at(1.01, 0.01) > 0
    for _ in range(10):
        mapper.scan(wall_ahead(1.0))
    assert mapper.at(1.01, 0.01) == log_odds(HIGH, once_free=True)
    scans = 0
    while mapper.at(1.01, 0.01) > 0:
        mapper.scan(np.full(BEAMS, RANGE))
        scans += 1
    # Half of the beams are traced in a scan.
    assert HIGH / MISS <= scans <= 2 * HIGH / MISS


def test_nothing_is_known_behind_an_obstacle_or_beyond_the_range() -> None:
    mapper = Mapper()
    for _ in range(4):
        mapper.scan(wall_ahead(1.0))
    assert mapper.at(1.4, 0.01) == 0
    assert mapper.at(0.6, 0.01) < 0
    assert mapper.at(0.0, RANGE + 0.2) == 0
    assert min(mapper.at(0.01 * k, RANGE - 0.3) for k in range(-12, 13)) < 0


@pytest.mark.parametrize("bad", [math.nan, 0.0, -1.0])
def test_a_range_that_tells_nothing_leaves_no_trace(bad: float) -> None:
    mapper = Mapper()
    mapper.scan(np.full(BEAMS, bad))
    assert not mapper.cells.any()


def test_a_dropout_does_not_open_a_wall() -> None:
    """One beam of a wall reads the greatest range: its neighbours vouch for the wall."""
    mapper = Mapper()
    for _ in range(20):
        mapper.scan(wall_ahead(1.0, 9))
    before = mapper.cells.copy()
    dropped = wall_ahead(1.0, 9)
    dropped[BEAMS // 2] = RANGE
    for _ in range(60):
        mapper.scan(dropped)
    assert (mapper.cells[before > 0] > 0).all()


def test_the_window_moves_with_the_robot_and_keeps_what_it_knows() -> None:
    mapper = Mapper()
    for _ in range(5):
        mapper.scan(wall_ahead(1.0))
    known = mapper.at(1.01, 0.01), mapper.at(0.5, 0.01)
    first = mapper.b["origin"].copy()
    mapper.scan(np.full(BEAMS, math.nan), (1.6, -1.7, 0.0))
    moved = mapper.b["origin"][0] - first[0]
    assert moved[0] < -5
    assert moved[1] > 5
    assert (mapper.at(1.01, 0.01), mapper.at(0.5, 0.01)) == known
    mapper.scan(np.full(BEAMS, math.nan), (500.0, 0.0, 0.0))
    assert not mapper.cells.any()


def test_the_robot_stands_on_free_ground() -> None:
    mapper = Mapper(body_radius_m=0.3)
    mapper.scan(np.full(BEAMS, 0.1))
    assert mapper.at(0.1, 0.0) == log_odds(LOW, once_free=True)


def test_sight() -> None:
    mapper = Mapper()
    for _ in range(5):
        mapper.scan(wall_ahead(1.0))
    assert not mapper.sees(2.0, 0.0)
    assert mapper.sees(-2.0, 0.0)
    assert mapper.sees(-2.0, 0.0, known=True)
    assert mapper.sees(-6.0, 0.0)
    assert not mapper.sees(-6.0, 0.0, known=True)
    assert not mapper.sees(1.0, 0.35)  # past the edge, but not a robot's width past it


def test_bad_input_is_refused() -> None:
    mapper = Mapper()
    with pytest.raises(ValueError, match="pose"):
        mapper.scan(np.ones(BEAMS), (math.nan, 0.0, 0.0))
    with pytest.raises(ValueError, match="beam"):
        mapper.scan(np.ones(BEAMS + 1))
    with pytest.raises(ValueError, match="log_odds"):
        make_native(make_buffers() | {"log_odds": np.zeros((1, SIDE, SIDE + 1), dtype=np.int8)})


@pytest.mark.parametrize(
    ("name", "value"),
    [("low", -64), ("low", 1), ("high", 64), ("high", 0), ("hit", 127), ("hit", 20), ("miss", -1)],
)
def test_evidence_that_a_cell_cannot_hold_is_refused(name: str, value: int) -> None:
    """A cell is eight bits, twice the evidence; a hit of no more than -low would leave a free cell free."""
    make_native(make_buffers(), low=-63, high=63, hit=126)
    with pytest.raises(ValueError, match="evidence: give"):
        make_native(make_buffers(), **{name: value})
