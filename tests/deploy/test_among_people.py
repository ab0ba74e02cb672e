"""The supervisor and the recovery among people: braking by what moves in the scans, and going on after it."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from adrl import _core
from adrl.benchmarks.fault_drives import policy_of
from adrl.benchmarks.witness import Witness
from adrl.deploy import Navigator, Supervisor, Twist
from adrl.deploy.recovery import PATIENCE_S
from adrl.deploy.surroundings import Surroundings
from adrl.envs import NavSim
from adrl.evaluation.supervised import as_odometry, as_scan
from adrl.types import Array, People, RobotConfig, Task, World
from adrl.worlds import ROBOTS
from adrl.worlds.shapes import enclosure
from deploy.closed_loop import rid_of_noise

DIFFBOT = ROBOTS["diffbot"]
BOUNDS = (-6.0, -6.0, 6.0, 6.0)
NOTHING = np.empty((0, 6))


def walkers(routes: list[list[tuple[float, float]]], speed_mps: Any, **more: Any) -> People:
    """Who walk on whether or not the robot is there."""
    count = len(routes)
    return People(
        routes=tuple(np.array(route) for route in routes),
        radius_m=np.full(count, 0.25),
        speed_mps=np.broadcast_to(speed_mps, count),
        share=np.zeros(count),
        reaction_s=np.full(count, 0.1),
        group=np.full(count, -1),
        **more,
    )


def a_task(who: People, start: tuple[float, float, float], goal: tuple[float, float], **world: Any) -> Task:
    shapes: dict[str, Any] = {"segments": enclosure(BOUNDS)} | world
    place = World(bounds=BOUNDS, **shapes)
    return Task(
        world=place,
        start=start,
        goal=goal,
        path=np.array([start[:2], goal]),
        shortest_m=math.dist(start[:2], goal),
        time_limit_s=1e9,
        people=who,
    )


def among(tasks: list[Task], robot: RobotConfig = DIFFBOT) -> NavSim:
    sim = NavSim(len(tasks), robot)
    seeds = np.arange(len(tasks), dtype=np.uint64)
    sim.reset(np.arange(len(tasks)), tasks, seeds, np.random.default_rng(0))
    return sim


def crossing(seed: int, count: int = 10, *, legs: bool = False) -> Task:
    """People who look at nobody's way cross the robot's."""
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-5.0, 5.0, (4 * count, 2))
    starts = starts[np.hypot(starts[:, 0] + 4.0, starts[:, 1]) > 1.5][:count]
    ends = -starts + rng.uniform(-1.5, 1.5, starts.shape)
    routes = [[tuple(a), tuple(np.clip(b, -5.0, 5.0))] for a, b in zip(starts, ends, strict=True)]
    who = walkers(routes, rng.uniform(0.5, 1.5, len(starts)), legs=legs)
    return a_task(who, (-4.0, 0.0, 0.0), (1e3, 0.0))


def drive_blindly(tasks: list[Task], robot: RobotConfig, steps: int) -> tuple[int, int, float]:
    """Straight on and in curves, behind supervisors, until something is hit: collisions of the robots' own fault, those
    of them that braking would have avoided, and metres driven in the mean."""
    sim = among(tasks, robot)
    supervisors = [Supervisor(robot) for _ in tasks]
    witnesses = [Witness(robot) for _ in tasks]
    at_fault = avoidable = 0
    for k in range(steps):
        now_s = k * robot.control_period_s
        for i in np.flatnonzero(sim.b["active"]).tolist():
            witnesses[i].look(sim, i)
            scan = as_scan(sim.b["ranges"][i], robot.lidar, now_s)
            faults = supervisors[i].watch(scan, as_odometry(sim, i, now_s), now_s)
            wanted: Twist = (robot.max_speed_mps, 0.5 * math.sin(0.1 * k + i) * robot.max_yaw_rate_radps)
            twist, _ = supervisors[i].stop(now_s, faults) if faults else supervisors[i].limit(wanted, now_s)
            sim.b["command"][i] = twist
        sim.native.step()
        for i in np.flatnonzero(sim.b["collided"] & sim.b["active"]).tolist():
            if sim.b["at_fault"][i]:
                at_fault += 1
                avoidable += witnesses[i].could_brake(sim, i)
            sim.b["active"][i] = 0
    return at_fault, avoidable, float(sim.b["travelled"].mean())


@pytest.mark.parametrize("legs", [False, True])
def test_nobody_is_driven_into_whom_braking_would_have_spared(
    legs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And without a look at what moves some are: so the test can fail."""
    tasks = [crossing(seed, legs=legs) for seed in range(8)]
    _, avoidable, driven_m = drive_blindly(tasks, DIFFBOT, 80)
    assert avoidable == 0
    assert driven_m > 0.8
    monkeypatch.setattr(Surroundings, "moving_from", lambda self, pose, time_s: NOTHING)
    at_fault, _, _ = drive_blindly(tasks, DIFFBOT, 80)
    assert at_fault > 0


@pytest.mark.parametrize("turn", [0.0, 0.8])
def test_velocities_are_those_of_who_walks_and_nothing_that_stands_moves(turn: float) -> None:
    """While the robot drives and turns between walls and pillars that hide one another."""
    who = walkers([[(2.0, -2.5), (2.0, 5.0)], [(4.5, 1.0), (-5.0, 1.0)]], [1.2, 0.8])
    pillars = np.array([(1.0, 2.0, 0.2), (-1.0, -1.5, 0.3), (3.0, -3.0, 0.2), (0.5, -3.0, 0.15)])
    sim = among([a_task(who, (-2.0, 0.0, 0.0), (1e3, 0.0), circles=pillars)])
    around = Surroundings(DIFFBOT, DIFFBOT.lidar.mount, margin_m=0.02, largest_hole_rad=0.35)
    off: list[float] = []
    for k in range(25):
        pose = tuple(sim.b["odometry"][0].tolist())
        around.take(as_scan(sim.b["ranges"][0], DIFFBOT.lidar, 0.1 * k), pose, pose)
        moving = around.moving_from(pose, 0.1 * k)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        for x, y, _, vx, vy, age_s in moving:
            place = np.array([pose[0] + c * x - s * y, pose[1] + s * x + c * y])
            people = sim.b["people"][0, :2]
            nearest = people[np.hypot(*(people[:, :2] - place).T).argmin()]
            assert np.hypot(*(nearest[:2] - place)) < 0.4, "what stands does not move"
            off.append(math.hypot(c * vx - s * vy - nearest[2], s * vx + c * vy - nearest[3]))
            assert age_s == pytest.approx(0.0)
        sim.b["command"][0] = (0.5, turn)
        sim.native.step()
    assert len(off) > 60
    assert np.quantile(off, 0.9) < 0.35


def test_legs_are_given_the_room_of_the_body_about_them() -> None:
    """Whichever way a person walks or has walked by, and wherever the legs are: a LiDAR near the floor sees no more."""
    ways = [
        [(2.0, -2.5), (2.0, 2.5)],
        [(4.5, 0.6), (-5.0, 0.6)],
        [(-1.5, 2.5), (-1.2, -0.8)],
        [(-4.0, -1.4), (4.0, -0.9)],
    ]
    who = walkers(ways, [1.3, 0.9, 0.7, 1.5], legs=True)
    sim = among([a_task(who, (0.0, 0.0, 0.0), (1e3, 0.0))], rid_of_noise(DIFFBOT))
    around = Surroundings(DIFFBOT, DIFFBOT.lidar.mount, margin_m=0.02, largest_hole_rad=0.35)
    looked = 0
    for k in range(45):
        pose = tuple(sim.b["odometry"][0].tolist())
        around.take(as_scan(sim.b["ranges"][0], DIFFBOT.lidar, 0.1 * k), pose, pose)
        known = around.moving_from(pose, 0.1 * k)
        for x, y, vx, vy in sim.b["people"][0, : len(who), :4]:
            own = known[np.hypot(known[:, 0] - x, known[:, 1] - y) < 0.3]
            if len(own) == 0 or math.hypot(x, y) > 3.0 or math.hypot(vx, vy) < 0.5:
                continue
            looked += 1
            room_m = (np.hypot(own[:, 0], own[:, 1]) - own[:, 2]).min()
            assert room_m < math.hypot(x, y) - 0.25
        sim.native.step()
    assert looked > 40


def test_scans_that_were_wrong_leave_what_moved_as_it_was_before_them() -> None:
    sim = among([a_task(walkers([[(2.0, -2.5), (2.0, 2.5)]], 1.0), (0.0, 0.0, 0.0), (1e3, 0.0))])
    around = Surroundings(DIFFBOT, DIFFBOT.lidar.mount, margin_m=0.02, largest_hole_rad=0.35)
    pose = (0.0, 0.0, 0.0)
    before = NOTHING
    for k in range(10):
        before = around.moving_from(pose, 0.1 * k)
        scan = as_scan(sim.b["ranges"][0], DIFFBOT.lidar, 0.1 * k)
        suspected = dataclasses.replace(scan, ranges=scan.ranges[:90].copy())
        around.take(suspected if k == 9 else scan, pose, pose, clears=k < 9)
        sim.native.step()
    assert len(around.moving_from(pose, 0.9)) != len(before) > 0
    around.revert()
    np.testing.assert_array_equal(around.moving_from(pose, 0.9)[:, :5], before[:, :5])


# --- the kernel --------------------------------------------------------------------------------------------


def a_base(robot: RobotConfig = DIFFBOT) -> "_core.Braking":
    response = (robot.max_acceleration_mps2, robot.max_yaw_acceleration_radps2, robot.lag_s)
    return _core.Braking(robot.radius_m or 0.0, robot.polygon, response, robot.control_period_s)


def lets(speed: float, hits: Array, moving: Array) -> bool:
    """Whether a robot at this speed may keep it for two periods."""
    return a_base().stays_clear((speed, 0.0), np.array([[speed, 0.0, 0.2]]), hits, moving)


def coming(x: float, y: float, vx: float, vy: float) -> tuple[Array, Array]:
    """One hit that moves: as hit, and as moving."""
    return np.array([[x, y, 0.02]]), np.array([[x, y, 0.02, vx, vy, 0.0]])


def test_what_comes_is_braked_for_sooner_than_what_stands_or_goes() -> None:
    def least_m(vx: float) -> float:
        return next(x for x in np.arange(0.25, 3.0, 0.01) if lets(0.6, *coming(float(x), 0.0, vx, 0.0)))

    stands, comes, goes = least_m(0.0), least_m(-1.5), least_m(1.5)
    assert comes > stands + 0.5
    assert goes == stands, "who walks on may stop at any time"


def test_what_comes_from_behind_or_beside_does_not_hold_a_robot_that_does_not_drive_into_it() -> None:
    for hits, moving in (
        coming(-0.3, 0.0, 1.5, 0.0),
        coming(0.0, 0.3, 1.0, 0.0),
        coming(-0.2, -0.3, 0.8, -0.2),
    ):
        assert lets(0.6, hits, moving)
    assert lets(0.0, *coming(0.3, 0.0, -1.5, 0.0)), "who stands may stand"
    hits, moving = coming(0.35, -0.5, 0.0, 1.5)
    assert not lets(0.6, hits, moving), "into the way of who crosses"


def test_a_person_who_walks_into_a_standing_robot_is_no_fault() -> None:
    sim = among([a_task(walkers([[(2.0, 0.0), (-5.0, 0.0)]], 1.0), (0.0, 0.0, 0.0), (1e3, 0.0))])
    supervisor = Supervisor(DIFFBOT)
    for k in range(40):
        now_s = 0.1 * k
        scan = as_scan(sim.b["ranges"][0], DIFFBOT.lidar, now_s)
        faults = supervisor.watch(scan, as_odometry(sim, 0, now_s), now_s)
        assert faults == ()
        sim.b["command"][0], _ = supervisor.limit((0.0, 0.0), now_s)
        sim.native.step()
        if sim.b["collided"][0]:
            break
    assert sim.b["collided"][0]
    assert not sim.b["at_fault"][0]


# --- standing for people, and going on -------------------------------------------------------------------------


def test_a_robot_that_has_stood_for_people_goes_on_without_a_way_out() -> None:
    """A stream of people crosses a corridor before it for longer than its patience; then the way is free."""
    robot = rid_of_noise(DIFFBOT)
    x = 1.3
    routes = [[(x, -1.0 - 1.0 * k), (x, 5.5)] for k in range(5)]
    sides = np.array(
        [(-3.0, 0.6, 0.7, 0.6), (-3.0, -0.6, 0.7, -0.6), (2.0, 0.6, 5.0, 0.6), (2.0, -0.6, 5.0, -0.6)]
    )
    task = a_task(
        walkers(routes, 0.8), (-0.5, 0.0, 0.0), (4.5, 0.0), segments=np.vstack([enclosure(BOUNDS), sides])
    )
    sim = among([task], robot)
    navigator = Navigator(policy_of(robot), world=task.world)
    navigator.set_goal(task.goal)
    waited, status = 0, "driving"
    for k in range(500):
        now_s = 0.1 * k
        scan = as_scan(sim.b["ranges"][0], robot.lidar, now_s)
        command = navigator.step(scan, as_odometry(sim, 0, now_s), now_s)
        status = command.status
        if status == "reached":
            break
        assert navigator.supervisor is not None
        waited += navigator.supervisor.waits
        sim.b["command"][0] = command.twist
        sim.native.step()
        assert not sim.b["at_fault"][0]
    assert status == "reached"
    assert waited > 0
    assert navigator.recoveries == 0


def test_time_that_a_robot_stands_for_people_does_not_count_as_stuck() -> None:
    """One after another comes towards it, for thrice its patience; who stands before it for good is another thing."""
    from adrl.deploy.recovery import Recovery

    supervisor = Supervisor(DIFFBOT)
    recovery = Recovery(supervisor)
    sim = among([a_task(walkers([[(3.0, 0.0), (-5.0, 0.0)]], 1.0), (-4.0, 0.0, 0.0), (1e3, 0.0))])
    for waits, helped in ((True, False), (False, True)):
        recovery.forget()
        ways = recovery.ways
        for k in range(round(3.0 * PATIENCE_S / 0.1)):
            now_s = 0.1 * k + (0.0 if waits else 100.0)
            scan = as_scan(sim.b["ranges"][0], DIFFBOT.lidar, now_s)
            supervisor.watch(scan, as_odometry(sim, 0, now_s), now_s)
            recovery.twist(0.0, now_s)
            supervisor.limit((0.0, 0.0), now_s)
            supervisor.waits = waits
            recovery.watch(now_s)
        assert (recovery.ways > ways) is helped
