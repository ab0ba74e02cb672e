"""BatchSim: equal bytes whatever the threads and the company, all state in buffers, bad buffers refused."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from adrl import _core
from adrl.planning.local_control import LocalControl, dwa_config
from adrl.types import Array, Task
from core.arenas import moved, random_world
from core.fleet import EMPTY, OUTPUTS, WALLED, Fleet, a_robot, a_task, assert_equal_bytes, buffers

N = 23
COMMON: dict[str, Any] = dict(range_noise=0.02, dropout=0.05, lag_s=0.05, latency_s=0.13, acceleration=3.0)


def tasks() -> list[Task]:
    """A task in another world for each robot; some collide soon, some reach their goal, some run free."""
    out = []
    for i in range(N):
        by = (0.3 * i, -0.2 * i, 0.7 * i)
        world = moved(WALLED, by) if i % 2 else random_world(np.random.default_rng(i), 4)
        at = by if i % 2 else (0.0, 0.0, 0.1 * i)
        goal = (at[0] + math.cos(at[2]), at[1] + math.sin(at[2]))
        out.append(a_task(world, start=at, goal=goal))
    return out


def a_fleet(num_threads: int = 1, of: list[Task] | None = None) -> Fleet:
    robot = a_robot(polygon=True, beams=33)
    return Fleet(of or tasks(), robot, num_threads=num_threads, odometry_yaw_error=0.1, **COMMON)


def commands(step: int) -> Array:
    return np.random.default_rng(step).uniform(-1.5, 3.0, (N, 2))


def run(fleet: Fleet, steps: range) -> Fleet:
    """Commanded at random, every other step by A*+DWA."""
    for step in steps:
        fleet.step(commands(step) if step % 2 else fleet.plan())
    return fleet


@pytest.mark.parametrize("num_threads", [2, 3, 7])
def test_equal_bytes_for_any_number_of_threads(num_threads: int):
    one, many = a_fleet().reset(), a_fleet(num_threads).reset()
    assert (one.sim.num_threads, many.sim.num_threads) == (1, num_threads)
    assert_equal_bytes(one.b, many.b)
    for step in range(20):
        run(one, range(step, step + 1))
        run(many, range(step, step + 1))
        assert_equal_bytes(one.b, many.b)
    assert 0 < one.b["collided"].sum() < N


def test_no_threads_asked_for_means_one_a_core():
    assert a_fleet(0).sim.num_threads >= 1


@pytest.mark.parametrize("i", [0, 7, N - 1])
def test_a_robot_alone_is_the_same_robot_among_others(i: int):
    among = a_fleet().reset()
    alone = a_fleet(of=[tasks()[i]])
    alone.b["seed"][:] = among.b["seed"][i]
    alone.reset()
    for step in range(12):
        command = commands(step) if step % 2 else among.plan()
        if step % 2 == 0:
            assert_array_equal(alone.plan()[0], command[i])
        among.step(command)
        alone.step(command[i])
        for name in OUTPUTS:
            assert alone.b[name][0].tobytes() == among.b[name][i].tobytes(), name


def test_buffers_hold_all_state():
    """Copied out and put into a simulator that knows the tasks only, they continue to the same bytes."""
    straight = run(a_fleet().reset(), range(8))
    saved = straight.snapshot()
    run(straight, range(8, 20))
    other = a_fleet(3)
    for name, array in saved.items():
        other.b[name][:] = array
    run(other, range(8, 20))
    assert_equal_bytes(straight.b, other.b)


def test_the_same_simulator_starts_again_to_the_same_bytes():
    fleet = run(a_fleet().reset(), range(6))
    first = fleet.snapshot()
    run(fleet.reset(), range(6))
    assert_equal_bytes(first, fleet.b)


def test_reset_puts_a_robot_at_rest_at_its_start():
    robots = tasks()
    fleet = run(a_fleet(of=robots).reset(), range(5))
    fleet.reset()
    b = fleet.b
    for i, task in enumerate(robots):
        assert_array_equal(b["pose"][i], task.start)
        assert_array_equal(b["odometry"][i], task.start)
        free = _core.clearance(
            task.world.native, np.array([task.start]), 0.0, a_robot(polygon=True).polygon, 1.0
        )
        assert b["clearance"][i] == b["least_clearance"][i] == free[0]
        assert b["collided"][i] == (free[0] <= 0.0)
    for name in ("twist", "time", "travelled", "reached"):
        assert_array_equal(b[name], 0)


def test_reset_leaves_rows_outside_the_mask_alone():
    fleet = run(a_fleet().reset(), range(5))
    before = fleet.snapshot()
    mask = (np.arange(N) % 3 == 0).astype(np.uint8)
    fleet.sim.reset(mask)
    assert_equal_bytes(before, fleet.b, mask == 0)
    assert_array_equal(fleet.b["time"][mask == 1], 0.0)
    assert np.any(fleet.b["time"][mask == 0] > 0.0)


def test_inactive_rows_are_not_touched():
    fleet = run(a_fleet().reset(), range(3))
    fleet.b["active"][::2] = 0
    before = fleet.snapshot()
    out = np.full((N, 2), 99.0)
    asked = np.ones(N, np.uint8)
    asked[1] = 0
    fleet.sim.plan(asked, fleet.control.native, out)
    assert np.all(out[::2] == 99.0)
    assert np.all(out[1] == 99.0), "nor those that are not asked for"
    assert np.all(out[3::2] < 99.0)
    fleet.step(commands(0))
    assert_equal_bytes(before, fleet.b, slice(0, None, 2))
    assert np.all(fleet.b["memory"][1::2, 1] == before["memory"][1::2, 1] + 1)


def test_inputs_are_only_read():
    fleet = a_fleet().reset()
    fleet.b["command"][:] = commands(0)
    before = fleet.snapshot()
    fleet.step()
    fleet.plan()
    for name in ("command", "active", "seed", "params"):
        assert_array_equal(fleet.b[name], before[name])


def test_a_robot_without_a_task_waits():
    robot = a_robot()
    b = buffers(2, robot.lidar.num_beams)
    b["active"][:] = 1
    sim = _core.BatchSim(2, 1, [(robot.native, _core.SimConfig())], b)
    sim.set_task(1, a_task(EMPTY, start=(1.0, 0.0, 0.0)).native)
    sim.reset(np.ones(2, dtype=np.uint8))
    sim.step()
    assert_array_equal(b["pose"][0], 0.0)
    assert_array_equal(b["ranges"][0], 0.0)
    assert_array_equal(b["pose"][1], [1.0, 0.0, 0.0])
    with pytest.raises(IndexError):
        sim.set_task(2, a_task(EMPTY).native)
    with pytest.raises(IndexError):
        sim.set_task(-1, a_task(EMPTY).native)


def test_a_goal_between_two_instants_is_reached():
    """3 m/s and 0.1 s: the robot crosses a goal of 0.05 m between one instant and the next."""
    fleet = Fleet([a_task(EMPTY, goal=(1.0, 0.0), goal_tolerance_m=0.05)], a_robot()).reset()
    reached = []
    for _ in range(6):
        reached.append(int(fleet.step((3.0, 0.0)).b["reached"][0]))
    assert sum(reached) == 1
    assert abs(fleet.b["pose"][0, 0] - 1.0) > 0.05


def test_waypoint_and_rest_of_the_route_follow_the_path():
    path = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 3.0]])
    config = _core.SimConfig()
    config.lookahead_m = 1.5
    fleet = Fleet([a_task(EMPTY, goal=(2.0, 3.0), path=path)], a_robot(), config=config).reset()
    for step in range(6):
        x = fleet.b["pose"][0, 0]
        assert_array_equal(fleet.b["route_left"][0], 5.0 - x)
        ahead = x + 1.5
        expected = [ahead, 0.0] if ahead <= 2.0 else [2.0, ahead - 2.0]
        np.testing.assert_allclose(fleet.b["waypoint"][0], expected, atol=1e-12)
        fleet.step((2.0 if step else 4.0, 0.0))
    config.lookahead_m = 0.0
    to_goal = Fleet([a_task(EMPTY, goal=(2.0, 3.0), path=path)], a_robot(), config=config).reset()
    assert_array_equal(to_goal.b["waypoint"][0], [2.0, 3.0])
    config.waypoint_is_given = True
    led = Fleet([a_task(EMPTY, goal=(2.0, 3.0), path=path)], a_robot(), config=config).reset()
    led.b["waypoint"][0] = (7.0, 8.0)
    led.step((1.0, 0.0))
    assert_array_equal(led.b["waypoint"][0], [7.0, 8.0])
    assert led.b["route_left"][0] < 5.0


# --- bad buffers --------------------------------------------------------------------------------


def make(**changes: Any) -> _core.BatchSim:
    robot = a_robot()
    return _core.BatchSim(
        3, 1, [(robot.native, _core.SimConfig())], buffers(3, robot.lidar.num_beams) | changes
    )


@pytest.mark.parametrize("name", buffers(3, 16))
def test_buffers_of_the_wrong_kind_are_refused(name: str):
    good = buffers(3, 16)[name]
    other = np.float32 if good.dtype == np.float64 else np.float64
    frozen = good.copy()
    frozen.flags.writeable = False
    wrong: list[Any] = [
        good.astype(other),
        good[:2].copy(),
        good[..., None].copy(),
        np.repeat(good, 2, axis=0)[::2],
        good.tolist(),
        None,
        frozen,
        good.astype(bool),
    ]
    if good.itemsize > 1:
        wrong.append(good.astype(good.dtype.newbyteorder()))
    if good.ndim == 2:
        wrong += [np.asfortranarray(good), good[:, :1].copy(), good.ravel()]
    make(**{name: good})
    for array in wrong:
        with pytest.raises((TypeError, ValueError), match=name):
            make(**{name: array})
    missing = buffers(3, 16)
    del missing[name]
    with pytest.raises((TypeError, ValueError, KeyError), match=name):
        _core.BatchSim(3, 1, [(a_robot().native, _core.SimConfig())], missing)


def test_masks_and_outputs_of_the_wrong_kind_are_refused():
    sim, control = make(), LocalControl(3, a_robot(), dwa_config(a_robot())).native
    for mask in (
        np.ones(3, dtype=bool),
        np.ones(3),
        [1, 1, 1],
        np.ones(6, np.uint8)[::2],
        np.ones((3, 1), np.uint8),
    ):
        with pytest.raises(TypeError):
            sim.reset(mask)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="mask"):
        sim.reset(np.ones(2, dtype=np.uint8))
    every = np.ones(3, np.uint8)
    for out in (np.ones((3, 2), np.float32), np.ones((3, 3)), np.ones((2, 3)).T, np.ones((6, 2))[::2]):
        with pytest.raises(TypeError):
            sim.plan(every, control, out)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="out"):
        sim.plan(every, control, np.ones((2, 2)))
    few = LocalControl(2, a_robot(), dwa_config(a_robot())).native
    with pytest.raises(ValueError, match="control"):
        sim.plan(every, few, np.ones((3, 2)))
    with pytest.raises(ValueError, match="mask"):
        sim.plan(every[:2], control, np.ones((3, 2)))


def test_rows_of_no_kind_are_refused():
    """Whatever stands in the caller's array, kernels read no kind that is not there."""
    robot, b = a_robot(), buffers(3, 16)
    sim = make(**b)
    control = LocalControl(3, robot, dwa_config(robot), kind=b["kind"]).native
    for wrong in (-1, 1, 2**40):
        b["kind"][1] = wrong
        for call in (
            lambda: sim.reset(np.ones(3, np.uint8)),
            sim.step,
            lambda: sim.follow(np.zeros((3, 3))),
            lambda: sim.plan(np.ones(3, np.uint8), control, np.zeros((3, 2))),
        ):
            with pytest.raises(ValueError, match=f"row 1 is of kind {wrong}; give 0 to 0"):
                call()
    b["kind"][1] = 0
    sim.step()


def test_a_command_that_is_not_finite_moves_nobody():
    """A diverged policy is told so; its NaN in an inactive row does no harm."""
    fleet = a_fleet().reset()
    before = fleet.snapshot()
    for bad in (math.nan, math.inf, -math.inf):
        fleet.b["command"][:] = commands(1)
        fleet.b["command"][3, 1] = bad
        with pytest.raises(ValueError, match="command"):
            fleet.step()
        assert_equal_bytes(before, fleet.b)
    fleet.b["active"][3] = 0
    fleet.step()
    assert np.isfinite(fleet.b["pose"]).all()


def test_a_buffer_taken_out_of_the_dictionary_lives_on():
    """The simulator writes to the arrays it was given, whatever becomes of the dictionary."""
    fleet = Fleet([a_task(WALLED)], a_robot()).reset()
    kept, twin = dict(fleet.b), Fleet([a_task(WALLED)], a_robot()).reset()
    pose = fleet.b["pose"]
    fleet.b.clear()
    for _ in range(3):
        fleet.sim.step()
        twin.step()
    assert_equal_bytes(kept, twin.b)
    assert pose is kept["pose"]
