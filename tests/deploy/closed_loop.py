"""Simulated robots behind supervisors: what is commanded, what is hit."""

import dataclasses
from collections.abc import Callable

import numpy as np

from adrl.deploy import Scan, Supervisor, Twist
from adrl.envs import NavSim
from adrl.evaluation.supervised import as_odometry, as_scan
from adrl.types import Array, RobotConfig, Task, World


def task_in(world: World, start: tuple[float, float, float]) -> Task:
    """A task without an end: its goal is far away."""
    goal = (1e3, 1e3)
    path = np.array([start[:2], goal])
    return Task(world=world, start=start, goal=goal, path=path, shortest_m=1e3, time_limit_s=1e9)


def obstacle_course(rng: np.random.Generator, keep_free_m: float) -> World:
    """A walled yard, 5 m wide, full of circles, boxes and bars; free about the origin."""
    h = 2.5
    walls = [[-h, -h, h, -h], [h, -h, h, h], [h, h, -h, h], [-h, h, -h, -h]]
    circles, polygons = [], []
    while len(circles) + len(polygons) < 14:
        x, y = rng.uniform(-h, h, 2)
        size = rng.uniform(0.05, 0.4)
        if np.hypot(x, y) < keep_free_m + 1.5 * size:
            continue
        if rng.random() < 0.5:
            circles.append((x, y, size))
            continue
        yaw, other = rng.uniform(-np.pi, np.pi), rng.uniform(0.05, size + 0.05)
        corners = np.array([(size, other), (-size, other), (-size, -other), (size, -other)])
        turn = np.array([(np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))])
        polygons.append(corners @ turn + (x, y))
    return World(
        bounds=(-h, -h, h, h), circles=np.array(circles), polygons=tuple(polygons), segments=np.array(walls)
    )


def drive(
    robot: RobotConfig,
    worlds: list[World],
    command: Callable[[int, int], Twist],
    steps: int,
    make: Callable[[RobotConfig], Supervisor] = Supervisor,
    *,
    speeds: Array | None = None,
    channel: Callable[[Scan], Scan] = lambda scan: scan,
    stands_by: Callable[[int], bool] = lambda step: False,
) -> tuple[NavSim, Array]:
    """One robot a world, each behind a supervisor, told command(step, robot).

    speeds: (N, 2) at first; at rest when None. channel: what becomes of each scan. stands_by: whether another drives in
    a step, as commanded.
    Returns the simulator and (N,) metres that the robots drove.
    """
    n, period_s = len(worlds), robot.control_period_s
    sim = NavSim(n, robot)
    tasks = [task_in(world, (0.0, 0.0, 0.0)) for world in worlds]
    sim.reset(np.arange(n), tasks, np.arange(n, dtype=np.uint64), np.random.default_rng(0))
    if speeds is not None:
        sim.b["twist"][:] = speeds
    supervisors = [make(robot) for _ in worlds]
    for k in range(steps):
        now_s = k * period_s
        for i in np.flatnonzero(sim.b["active"]).tolist():
            scan = channel(as_scan(sim.b["ranges"][i], robot.lidar, now_s))
            faults = supervisors[i].watch(scan, as_odometry(sim, i, now_s), now_s)
            wanted = command(k, i)
            if stands_by(k):
                supervisors[i].stand_by(now_s)
                sim.b["command"][i] = wanted
                continue
            twist, _ = supervisors[i].stop(now_s, faults) if faults else supervisors[i].limit(wanted, now_s)
            sim.b["command"][i] = twist
        sim.native.step()
        sim.b["active"][sim.b["collided"] > 0] = 0
    return sim, sim.b["travelled"].copy()


def rid_of_noise(robot: RobotConfig, **changes: object) -> RobotConfig:
    """The robot with exact ranges, and other changes."""
    lidar = dataclasses.replace(robot.lidar, noise_std_m=0.0)
    return dataclasses.replace(robot, lidar=lidar, **changes)  # pyright: ignore
