"""How differential drives and cars move: exact arcs, lag, limits, latency, gains and odometry."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from adrl import _core
from adrl.types import Array, World
from core import twins
from core.arenas import mirrored, poses
from core.fleet import EMPTY, WALLED, Fleet, a_robot, a_task
from core.twins import Pose

speeds = st.floats(-3.0, 3.0)
periods = st.floats(0.0, 1.0)
STAYS = 1e-12


def integrate(pose: Pose, v: float, w: float, dt_s: float) -> Array:
    return _core.integrate(np.array([pose]), np.array([[v, w]]), dt_s)[0]


def assert_same_pose(one: Array, other: object, tolerance: float = 1e-9) -> None:
    difference = np.asarray(one) - np.asarray(other)
    assert_allclose(difference[..., :2], 0.0, atol=tolerance)
    assert_allclose(np.sin(0.5 * difference[..., 2]), 0.0, atol=tolerance)


# --- exact arcs ---------------------------------------------------------------------------------


@given(poses, speeds, st.one_of(st.just(0.0), speeds.filter(lambda w: abs(w) > 1e-3)), periods)
def test_arcs_are_the_printed_equation(pose: Pose, v: float, w: float, dt_s: float):
    moved = integrate(pose, v, w, dt_s)
    assert_same_pose(moved, twins.integrate(pose, v, w, dt_s))
    assert -math.pi < moved[2] <= math.pi


@given(poses, speeds, speeds, periods, st.floats(0.0, 1.0))
def test_two_parts_equal_one_step(pose: Pose, v: float, w: float, dt_s: float, share: float):
    halfway = integrate(pose, v, w, share * dt_s)
    assert_same_pose(integrate(tuple(halfway), v, w, (1.0 - share) * dt_s), integrate(pose, v, w, dt_s))


@given(poses, speeds, st.floats(-1e-3, 1e-3), periods)
def test_a_small_turn_meets_the_straight_line(pose: Pose, v: float, w: float, dt_s: float):
    """The arc leaves its tangent by v w dt^2 / 2 and no more, however small w is."""
    off = integrate(pose, v, w, dt_s)[:2] - integrate(pose, v, 0.0, dt_s)[:2]
    assert np.hypot(*off) <= 0.5 * abs(v * w) * dt_s**2 * (1.0 + 1e-6) + 1e-14


@given(poses, speeds, speeds, periods)
def test_mirrored_turn_mirrored_arc(pose: Pose, v: float, w: float, dt_s: float):
    flip = np.array([1.0, -1.0, -1.0])
    assert_same_pose(
        integrate((pose[0], -pose[1], -pose[2]), v, -w, dt_s), integrate(pose, v, w, dt_s) * flip
    )


@given(poses, speeds, speeds, periods)
def test_driving_back_ends_at_the_start(pose: Pose, v: float, w: float, dt_s: float):
    assert_same_pose(integrate(tuple(integrate(pose, v, w, dt_s)), -v, -w, dt_s), pose)


def test_poses_and_twists_must_match():
    with pytest.raises(ValueError, match="length"):
        _core.integrate(np.zeros((2, 3)), np.zeros((3, 2)), 0.1)
    with pytest.raises(TypeError):
        _core.integrate(np.zeros((2, 3)), np.zeros((2, 2), np.float32), 0.1)  # pyright: ignore[reportArgumentType]


# --- the base, through BatchSim -----------------------------------------------------------------


def twin_run(
    start: Pose, commands: Array, dt_s: float, *, odometry: bool = False, radius_m: float = 0.0, **p: float
) -> tuple[Array, Array]:
    """(T, 3) poses, (T, 2) twists in the open: what is due, then lag and limits, then the arc.

    radius_m: of the tightest curve of a car.
    """
    pose, twist, history = start, (0.0, 0.0), [(0.0, 0.0)] * 9
    rows, twists = [], []
    errors = (
        (p.get("odometry_speed_error", 0.0), p.get("odometry_yaw_error", 0.0)) if odometry else (0.0, 0.0)
    )
    lag, acceleration = p.get("lag_s", 0.0), (p.get("acceleration", 1e6), p.get("yaw_acceleration", 1e6))
    gain = (p.get("speed_gain", 1.0), p.get("yaw_gain", 1.0))
    whole, part = divmod(p.get("latency_s", 0.0) / dt_s, 1.0)
    for command in commands:
        history = [twins.steered((float(command[0]), float(command[1])), radius_m), *history[:-1]]
        for span, due in ((part * dt_s, int(whole) + 1), ((1.0 - part) * dt_s, int(whole))):
            if span <= 0.0:
                continue
            wanted = [history[due][k] * gain[k] for k in (0, 1)]
            after = [twins.follow(twist[k], wanted[k], lag, acceleration[k], span) for k in (0, 1)]
            after = twins.steered((after[0], after[1]), radius_m)
            arc = twins.steered((0.5 * (twist[0] + after[0]), 0.5 * (twist[1] + after[1])), radius_m)
            mean = [arc[k] * (1.0 + errors[k]) for k in (0, 1)]
            pose = twins.integrate(pose, mean[0], mean[1] if abs(mean[1]) > 1e-9 else 0.0, span)
            twist = after
        rows.append(pose)
        twists.append(twist)
    return np.array(rows), np.array(twists)


def run(
    commands: Array, start: Pose = (0.0, 0.0, 0.0), world: World = EMPTY, *, radius_m: float = 0.0, **p: Any
) -> dict[str, Array]:
    """(T, ...) history of every float64 buffer of one robot of 3 m/s."""
    robot = replace(a_robot(), min_turning_radius_m=radius_m)
    fleet = Fleet([a_task(world, start=start)], robot, **p).reset()
    rows = [fleet.step(command).snapshot() for command in commands]
    return {name: np.array([row[name][0] for row in rows]) for name in rows[0]}


def some_commands(seed: int, count: int = 25) -> Array:
    return np.random.default_rng(seed).uniform(-2.9, 2.9, (count, 2))


BASES = {
    "ideal": {},
    "lag": dict(lag_s=0.15),
    "weak": dict(acceleration=1.5, yaw_acceleration=4.0),
    "late": dict(latency_s=0.3),
    "a bit late": dict(latency_s=0.04),
    "later": dict(latency_s=0.57),
    "gains": dict(speed_gain=0.9, yaw_gain=1.1),
    "all": dict(
        speed_gain=1.05, yaw_gain=0.9, acceleration=2.0, yaw_acceleration=6.0, lag_s=0.08, latency_s=0.125,
        odometry_speed_error=0.04, odometry_yaw_error=-0.07,
    ),
}  # fmt: skip


@pytest.mark.parametrize("base", BASES)
@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), start=poses)
def test_the_base_is_its_twin(base: str, seed: int, start: Pose):
    commands = some_commands(seed)
    got = run(commands, start, **BASES[base])
    expected, twists = twin_run(start, commands, 0.1, **BASES[base])
    assert_same_pose(got["pose"], expected, 1e-7)
    assert_allclose(got["twist"], twists, atol=1e-9)
    odometry, _ = twin_run(start, commands, 0.1, odometry=True, **BASES[base])
    assert_same_pose(got["odometry"], odometry, 1e-7)
    assert_allclose(got["time"], 0.1 * np.arange(1, 26), atol=1e-12)


@pytest.mark.parametrize("base", BASES)
@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), start=poses, radius_m=st.floats(0.05, 10.0))
def test_a_car_is_its_twin_and_turns_no_tighter_than_it_can(
    base: str, seed: int, start: Pose, radius_m: float
):
    """|w| R <= |v| in every twist and on every arc, whatever it is told, accelerating and through standstill too."""
    commands = some_commands(seed)
    got = run(commands, start, radius_m=radius_m, **BASES[base])
    expected, twists = twin_run(start, commands, 0.1, radius_m=radius_m, **BASES[base])
    assert_same_pose(got["pose"], expected, 1e-7)
    assert_allclose(got["twist"], twists, atol=1e-9)
    v, w = np.abs(got["twist"]).T
    assert (w * radius_m <= v + STAYS).all()
    turned = np.abs(np.diff(np.unwrap(np.concatenate([[start[2]], got["pose"][:, 2]]))))
    driven = np.diff(np.concatenate([[0.0], got["travelled"]]))
    assert (turned * radius_m <= driven + 1e-9).all()


@given(seed=st.integers(0, 2**32 - 1), radius_m=st.floats(0.05, 10.0))
def test_what_a_car_can_steer_it_does_as_any_other_robot(seed: int, radius_m: float):
    """One command, held from standstill: both speeds rise alike, so no twist on the way is steeper than it."""
    v, share = np.random.default_rng(seed).uniform(-1.0, 1.0, 2)
    hold = np.tile([v, share * abs(v) / radius_m], (10, 1))
    if abs(hold[0, 1]) > 2.9:
        return
    for name, array in run(hold, lag_s=0.15).items():
        assert_allclose(run(hold, radius_m=radius_m, lag_s=0.15)[name], array, atol=1e-9)


def test_a_car_does_not_turn_on_the_spot():
    still = run(np.tile([0.0, 2.0], (10, 1)), radius_m=0.5)
    assert_array_equal(still["pose"], 0.0)


@pytest.mark.parametrize("k", range(8))
def test_latency_of_k_periods_delays_the_motion_by_k_periods(k: int):
    commands = some_commands(k)
    prompt = run(commands)["pose"]
    late = run(commands, latency_s=k * 0.1)["pose"]
    assert_same_pose(late[k:], prompt[: len(prompt) - k], STAYS)
    assert_array_equal(late[:k], 0.0)


@given(st.integers(0, 6), st.floats(0.01, 0.99))
def test_a_part_of_a_period_lies_between_its_neighbours(whole: int, part: float):
    """One command, held: the way driven falls with every bit of latency."""
    hold = np.tile([1.0, 0.0], (12, 1))
    driven = [run(hold, latency_s=0.1 * periods)["travelled"] for periods in (whole, whole + part, whole + 1)]
    assert np.all(driven[0] >= driven[1])
    assert np.all(driven[1] >= driven[2])
    assert driven[0][-1] - 1e-4 > driven[1][-1] > driven[2][-1] + 1e-4


@given(st.floats(0.01, 1.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_lag_answers_exponentially(lag_s: float, v: float, w: float):
    got = run(np.tile([v, w], (20, 1)), lag_s=lag_s)["twist"]
    rise = 1.0 - np.exp(-0.1 * np.arange(1, 21) / lag_s)
    assert_allclose(got, rise[:, None] * [v, w], atol=1e-9)


@given(st.floats(0.1, 5.0), st.floats(0.1, 5.0), st.integers(0, 2**32 - 1), st.floats(0.0, 0.2))
def test_no_twist_changes_faster_than_the_limits(
    acceleration: float, yaw_acceleration: float, seed: int, lag_s: float
):
    got = run(some_commands(seed), acceleration=acceleration, yaw_acceleration=yaw_acceleration, lag_s=lag_s)[
        "twist"
    ]
    change = np.abs(np.diff(np.vstack([[0.0, 0.0], got]), axis=0))
    assert np.all(change <= np.array([acceleration, yaw_acceleration]) * 0.1 * (1.0 + 1e-9))


def test_full_acceleration_gains_speed_evenly():
    got = run(np.tile([3.0, 0.0], (10, 1)), acceleration=2.0)
    assert_allclose(got["twist"][:, 0], 0.2 * np.arange(1, 11))
    assert_allclose(got["travelled"], 0.5 * 2.0 * (0.1 * np.arange(1, 11)) ** 2)


def test_commands_beyond_the_limits_are_brought_inside():
    beyond, at = np.array([[99.0, -99.0], [-99.0, 99.0]]), np.array([[3.0, -3.0], [-3.0, 3.0]])
    assert run(beyond)["pose"].tobytes() == run(at)["pose"].tobytes()
    forward_only = Fleet([a_task(EMPTY)], a_robot(min_speed_mps=0.0)).reset()
    assert_array_equal(forward_only.step((-1.0, 0.5)).b["twist"][0], [0.0, 0.5])


def test_a_robot_told_to_stop_comes_to_rest():
    """A lag never quite arrives in exact numbers; the twist must still end at 0 and not in denormals."""
    commands = np.vstack([np.tile([2.0, 1.0], (5, 1)), np.zeros((60, 2))])
    assert_array_equal(run(commands, lag_s=0.05)["twist"][-1], 0.0)


@given(st.integers(0, 2**32 - 1))
def test_odometry_without_drift_is_the_truth_and_with_drift_is_not(seed: int):
    commands = some_commands(seed)
    exact = run(commands, latency_s=0.05, lag_s=0.1)
    assert exact["odometry"].tobytes() == exact["pose"].tobytes()
    drifts = run(commands, latency_s=0.05, lag_s=0.1, odometry_speed_error=0.05)
    assert drifts["pose"].tobytes() == exact["pose"].tobytes()
    assert np.abs(drifts["odometry"] - drifts["pose"])[-1, :2].max() > 1e-4


def test_odometry_errors_are_relative():
    hold = np.tile([1.0, 0.0], (10, 1))
    assert_allclose(run(hold, odometry_speed_error=0.1)["odometry"][-1, 0] / run(hold)["pose"][-1, 0], 1.1)
    turn = np.tile([0.0, 1.0], (10, 1))
    assert_allclose(run(turn, odometry_yaw_error=-0.2)["odometry"][-1, 2] / run(turn)["pose"][-1, 2], 0.8)


@given(st.integers(0, 2**32 - 1))
def test_mirrored_world_mirrored_turn(seed: int):
    commands = some_commands(seed, 15) * [0.3, 1.0]
    here = run(commands, (0.2, -0.3, 0.5), WALLED, lag_s=0.1)
    there = run(commands * [1.0, -1.0], (0.2, 0.3, -0.5), mirrored(WALLED), lag_s=0.1)
    assert_array_equal(here["collided"], there["collided"])
    assert_same_pose(there["pose"], here["pose"] * [1.0, -1.0, -1.0])
    assert_allclose(there["clearance"], here["clearance"], atol=1e-9)
    # Beam k of 16 points at -pi + k pi / 8; its mirror image is beam 16 - k. Grazing beams may go either way.
    seen, mirror = here["ranges"], np.roll(there["ranges"][:, ::-1], 1, axis=1)
    assert np.mean(np.abs(seen - mirror) > 1e-5) < 0.02
