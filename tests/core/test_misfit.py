"""How badly two scans fit under a motion between them, against a slow twin and the geometry itself."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl import _core
from adrl.geometry import compose, inverse
from adrl.types import Array
from deploy.closed_loop import obstacle_course

BEAMS = 180
FAN = (-math.pi, 2.0 * math.pi / BEAMS, 4.0)
ANGLES = FAN[0] + FAN[1] * np.arange(BEAMS, dtype=np.float64)


def scan_of(seed: int, pose: tuple[float, float, float]) -> Array:
    world = obstacle_course(np.random.default_rng(seed), 0.6)
    ranges = _core.raycast(world.native, np.array([pose]), ANGLES, FAN[2])[0].astype(np.float64)
    return np.where(ranges >= FAN[2], np.inf, ranges)


def twin(
    seen: Array, surface: Array, motion: tuple[float, float, float], scale_m: float
) -> tuple[float, int]:
    """The same, point by point, for a full circle."""
    hits = [(r * math.cos(a), r * math.sin(a)) for r, a in zip(surface, ANGLES, strict=True)]
    costs = []
    for r, a in zip(seen, ANGLES, strict=True):
        if not math.isfinite(r):
            continue
        x, y, _ = compose(motion, (r * math.cos(a), r * math.sin(a), 0.0))
        beam = ((math.atan2(y, x) - FAN[0]) / FAN[1]) % BEAMS
        i, j = int(beam), (int(beam) + 1) % BEAMS
        near, far = sorted((surface[i], surface[j]))
        if math.isnan(near) or math.isnan(far) or math.hypot(x, y) > 0.97 * FAN[2]:
            continue
        to = [math.hypot(x - hits[k][0], y - hits[k][1]) for k in (i, j) if math.isfinite(surface[k])]
        if len(to) == 2 and far - near <= 0.15 * near:
            (ax, ay), (bx, by) = hits[i], hits[j]
            to = [abs((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / math.hypot(bx - ax, by - ay)]
        costs.append(min(min(to, default=scale_m) / scale_m, 1.0))
    return (float(np.mean(costs)) if costs else 0.0), len(costs)


@given(
    st.integers(0, 50), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-3.0, 3.0), st.floats(0.0, 0.3)
)
def test_it_equals_its_twin(seed: int, x: float, y: float, yaw: float, lost: float):
    rng = np.random.default_rng(seed)
    seen, surface = scan_of(seed, (x, y, yaw)), scan_of(seed, (0.0, 0.0, 0.0))
    seen[rng.random(BEAMS) < lost] = np.nan
    surface[rng.random(BEAMS) < lost] = np.nan
    motions = np.array([(x, y, yaw), (0.0, 0.0, 0.0), (y, x, -yaw)])
    found = _core.misfits(seen, FAN, surface, FAN, motions, 0.1)
    expected = [twin(seen, surface, tuple(motion), 0.1) for motion in motions.tolist()]
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_the_motion_that_was_fits_best(seed: int):
    rng = np.random.default_rng(seed)
    a, b = (0.1, 0.0, 0.3), (0.25, 0.1, 0.1)
    motion = compose(inverse(a), b)
    others = [
        (motion[0] + dx, motion[1] + dy, motion[2] + turn) for dx, dy, turn in rng.uniform(-0.2, 0.2, (9, 3))
    ]
    fit = _core.misfits(scan_of(seed, b), FAN, scan_of(seed, a), FAN, np.array([motion, *others]), 0.1)
    assert fit[0, 0] == fit[:, 0].min() < 0.12


def test_a_scan_that_runs_clockwise_says_the_same():
    a, b = scan_of(1, (0.0, 0.0, 0.0)), scan_of(1, (0.1, 0.0, 0.2))
    motions, turned = np.array([(0.1, 0.0, 0.2), (0.03, 0.01, 0.05)]), (-FAN[0] - FAN[1], -FAN[1], FAN[2])
    there = _core.misfits(b, FAN, a, FAN, motions, 0.1)
    back = _core.misfits(b[::-1].copy(), turned, a[::-1].copy(), turned, motions, 0.1)
    np.testing.assert_allclose(there, back, atol=1e-9)


def test_nothing_told_is_nothing_compared():
    nothing = np.full(BEAMS, np.nan)
    assert _core.misfits(nothing, FAN, nothing, FAN, np.zeros((2, 3)), 0.1).tolist() == [[0.0, 0.0]] * 2
