"""Faults in the closed loop: simulator -> faulty channel -> runtime with supervisor -> base -> simulator.

Whatever happens to messages, clocks and the node itself: nothing is hit, and within two periods of a fault that takes
away the sensors the robot has been told to stand still; it stands after its own braking time.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import pytest

from adrl.deploy import Navigator, Odometry, Scan
from adrl.envs import NavSim
from adrl.evaluation.supervised import as_odometry, as_scan
from adrl.worlds import ROBOTS, single_task
from deploy.faulty_loop import FAULT, PERIODS, Channel, Loop, arrives, braking_periods, loop, outlasts
from deploy.recorded import a_policy
from env_tasks import room

Message = TypeVar("Message", Scan, Odometry)


def delayed(periods: int) -> Callable[[int, int, Message], Message | None]:
    """Messages that come so many periods late while the fault lasts."""
    waiting: dict[tuple[int, int], Message] = {}

    def delay(k: int, i: int, message: Message) -> Message | None:
        waiting[k, i] = message
        return waiting.get((k - periods, i)) if k in FAULT else message

    return delay


def stops_or_drives_on(run: Loop, periods_late: int) -> None:
    """One or two periods late is driven on with; more is a stop."""
    if periods_late > 2:
        outlasts(run)
        return
    assert run.drove_on(range(FAULT.start + PERIODS, FAULT.stop))
    arrives(run)


# --- the scan -----------------------------------------------------------------------------------------------


def faulty(change: Callable[[Scan], Scan | None]) -> Channel:
    return lambda k, i, scan: change(scan) if k in FAULT else scan


def garbled(kind: str) -> Callable[[Scan], Scan]:
    rng = np.random.default_rng(0)

    def change(scan: Scan) -> Scan:
        ranges = scan.ranges.copy()
        if kind == "nan":
            ranges[:] = np.nan
        elif kind == "half nan":
            ranges[len(ranges) // 2 :] = np.nan
        elif kind == "negative":
            ranges *= -1.0
        elif kind == "cut off":
            ranges = ranges[:10]
        elif kind == "many lost":
            ranges[rng.random(len(ranges)) < 0.8] = np.nan
        return dataclasses.replace(scan, ranges=ranges)

    return change


@pytest.mark.integration
@pytest.mark.parametrize("robot", ["diffbot", "turtlebot3_burger", "jackal"])
def test_dropped_scans(robot: str):
    run = loop(robot)
    run.run(FAULT.stop, faulty(lambda scan: None))
    outlasts(run)


@pytest.mark.integration
@pytest.mark.parametrize("kind", ["nan", "half nan", "negative", "cut off", "many lost"])
def test_corrupt_scans(kind: str):
    run = loop()
    run.run(FAULT.stop, faulty(garbled(kind)))
    outlasts(run)


@pytest.mark.integration
def test_noise_instead_of_scans():
    """It looks like a scan: no sensor tells. The braking check stops for what is not there."""
    run = loop()
    rng = np.random.default_rng(0)
    noise = faulty(lambda scan: dataclasses.replace(scan, ranges=rng.uniform(0.11, 6.0, len(scan.ranges))))
    run.run(FAULT.stop, noise)
    arrives(run)


@pytest.mark.integration
@pytest.mark.parametrize("stamped_anew", [True, False])
def test_frozen_scans(stamped_anew: bool):
    """The driver repeats its last scan, with new stamps or with the old one."""
    run = loop()
    last: dict[int, Scan] = {}

    def freeze(k: int, i: int, scan: Scan) -> Scan:
        if k not in FAULT:
            last[i] = scan
        return dataclasses.replace(last[i], stamp_s=scan.stamp_s) if stamped_anew else last[i]

    run.run(FAULT.stop, freeze)
    outlasts(run)


@pytest.mark.integration
@pytest.mark.parametrize("periods", [1, 2, 3, 10])
def test_delayed_scans(periods: int):
    """One or two periods late is driven on with, by the odometry; more is a stop."""
    run = loop()
    run.run(FAULT.stop, delayed(periods))
    stops_or_drives_on(run, periods)


@pytest.mark.integration
@pytest.mark.parametrize("most", [2, 6])
def test_reordered_scans(most: int):
    """Each scan is late by a time of its own: newer ones come before older ones, which are passed over."""
    run = loop()
    rng = np.random.default_rng(0)
    waiting: dict[tuple[int, int], list[Scan]] = {}

    def shuffle(k: int, i: int, scan: Scan) -> Scan | None:
        waiting.setdefault((k + int(rng.integers(0, most + 1)), i), []).append(scan)
        come = waiting.pop((k, i), [])
        return scan if k not in FAULT else (come[int(rng.integers(len(come)))] if come else None)

    run.run(FAULT.stop, shuffle)
    arrives(run)


@pytest.mark.integration
def test_dropped_odometry():
    run = loop()
    run.run(FAULT.stop, odometry=lambda k, i, message: None if k in FAULT else message)
    outlasts(run)


@pytest.mark.integration
@pytest.mark.parametrize("periods", [1, 2, 5])
def test_delayed_odometry(periods: int):
    """Of late, speed and place are reckoned on from the commands; of old, it is a stop."""
    run = loop()
    run.run(FAULT.stop, odometry=delayed(periods))
    stops_or_drives_on(run, periods)


@pytest.mark.integration
def test_odometry_that_is_no_number():
    run = loop()
    lost = (math.nan, 0.0, 0.0)
    run.run(FAULT.stop, odometry=lambda k, i, m: dataclasses.replace(m, pose=lost) if k in FAULT else m)
    outlasts(run)


# --- the clock ----------------------------------------------------------------------------------------------


@pytest.mark.integration
@pytest.mark.parametrize("by_s", [100.0, -100.0, -0.35])
def test_the_clock_jumps_for_all(by_s: float):
    """Sensors and node share it: at most a short stop."""
    run = loop()
    at_s = FAULT.start * run.robot.control_period_s
    run.run(FAULT.stop, clock=lambda time_s: time_s + (by_s if time_s >= at_s - 1e-9 else 0.0))
    assert run.drove_on(range(FAULT.start + 3, FAULT.stop))
    run.run(400, clock=lambda time_s: time_s + by_s)
    assert not run.hit.any()
    assert run.arrived.all()


@pytest.mark.integration
@pytest.mark.parametrize("by_s", [100.0, -100.0])
def test_the_sensors_clock_jumps(by_s: float):
    """The node's stays: nothing that arrives can be dated."""
    run = loop()

    redated = faulty(lambda scan: dataclasses.replace(scan, stamp_s=scan.stamp_s + by_s))
    run.run(FAULT.stop, redated)
    outlasts(run)


@pytest.mark.integration
@pytest.mark.parametrize("by_s", [100.0, -100.0])
def test_the_nodes_clock_jumps_which_says_nothing_of_the_base(by_s: float):
    """The sensors' stays. When the clocks agree again the base is neither late nor weak: it did as it was told."""
    run = loop()

    def clock(time_s: float) -> float:
        wrong = any(abs(time_s - k * run.robot.control_period_s) < 1e-9 for k in FAULT)
        return time_s + (by_s if wrong else 0.0)

    def dated(k: int, i: int, message: Message) -> Message:
        return dataclasses.replace(message, stamp_s=message.stamp_s - by_s) if k in FAULT else message

    run.run(FAULT.stop + 1, dated, odometry=dated, clock=clock)
    supervisors = [navigator.supervisor for navigator in run.navigators]
    assert not any("base" in caution for one in supervisors if one for caution in one.cautions)
    outlasts(run)


# --- the node and its goal ----------------------------------------------------------------------------------


@pytest.mark.integration
@pytest.mark.parametrize("robot", ["diffbot", "turtlebot3_burger", "jackal"])
def test_the_node_is_killed_and_started_again(robot: str):
    """The base's watchdog stops the robot; a new node waits for a goal and then goes on."""
    run = loop(robot)
    run.run(FAULT.stop, node=lambda k: k not in FAULT)
    assert run.told_to_stand(range(FAULT.start + PERIODS - 1, FAULT.stop))
    assert run.standing(range(FAULT.start + PERIODS + braking_periods(run.robot), FAULT.stop))
    run.navigators = [run.navigator(task) for task in run.tasks]
    run.run(5)
    assert run.told_to_stand(range(FAULT.stop, FAULT.stop + 5))
    assert {command.status for command in run.commands if command} <= {"idle", "reached"}
    for navigator, task in zip(run.navigators, run.tasks, strict=True):
        navigator.set_goal(task.goal)
    arrives(run)


@pytest.mark.integration
def test_the_goal_is_cancelled():
    run = loop()
    run.run(FAULT.start)
    for navigator in run.navigators:
        navigator.cancel()
    run.run(20)
    assert run.told_to_stand(range(FAULT.start, FAULT.start + 20))
    assert run.standing(range(FAULT.start + braking_periods(run.robot), FAULT.start + 20))
    assert not run.hit.any()


@pytest.mark.integration
@pytest.mark.parametrize("guidance", ["goal", "replan", "map"])
def test_the_goal_is_moved(guidance: str):
    """In an open room, to the other side, again and again; the last one counts."""
    robot = ROBOTS["diffbot"]
    goals = [(3.0, 0.0), (-3.0, 1.0), (0.0, -3.0), (2.0, 2.0)]
    run = Loop([single_task(room(), (-2.0, 0.0, 0.0), goals[0], robot)], robot, guidance)
    for goal in goals:
        run.navigators[0].set_goal(goal)
        run.run(25)
    run.run(300)
    assert not run.hit.any()
    assert run.arrived.all()
    assert math.dist(run.sim.b["pose"][0, :2], goals[-1]) < 0.35


@pytest.mark.integration
@pytest.mark.parametrize("guidance", ["goal", "replan", "map"])
def test_the_goal_is_behind_a_wall(guidance: str):
    """No way leads there: a map says so at once; without one nothing is hit, for as long as it tries."""
    robot = ROBOTS["diffbot"]
    task = single_task(room(segments=[]), (-2.0, 0.0, 0.0), (2.0, 0.0), robot)
    shut_off = dataclasses.replace(task, world=room(segments=[(0.0, -6.0, 0.0, 6.0)]))
    run = Loop([shut_off], robot, guidance)
    run.run(150)
    command = run.commands[0]
    assert command is not None
    assert not run.hit.any()
    if guidance == "map":
        assert run.told_to_stand(range(0, 150))
        assert not run.arrived.any()
        return
    assert command.status == "driving"
    run.navigators[0].cancel()
    run.run(20)
    assert run.told_to_stand(range(150, 170))
    assert run.standing(range(150 + braking_periods(robot), 170))


@pytest.mark.integration
def test_a_goal_without_a_way_fails_with_a_reason():
    robot = ROBOTS["diffbot"]
    world = room(segments=[(0.0, -6.0, 0.0, 6.0)])
    navigator = Navigator(a_policy(robot), guidance="map", world=world)
    navigator.set_goal((2.0, 0.0))
    sim = NavSim(1, robot)
    task = dataclasses.replace(single_task(room(), (-2.0, 0.0, 0.0), (2.0, 0.0), robot), world=world)
    sim.reset(np.array([0]), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
    scan = as_scan(sim.b["ranges"][0], robot.lidar, 0.0)
    command = navigator.step(scan, as_odometry(sim, 0, 0.0), 0.0)
    assert (command.status, command.twist) == ("failed", (0.0, 0.0))
    assert "cannot be reached" in command.message
    assert navigator.goal is None
