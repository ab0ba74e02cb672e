"""Random arenas with A* routes through them, and robots that A*+DWA drives, for the tests of the core."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.planning.local_control import local_lookahead_m
from adrl.types import Array, LidarConfig, OccupancyGrid, RobotConfig, Task, World
from core.arenas import box
from core.fleet import Fleet, a_task

SIDE_M = 5.0
CELL_M = 0.05
SIZE = round(2 * SIDE_M / CELL_M)
LIDAR = LidarConfig(num_beams=1)

ROBOTS = {
    "diffbot": RobotConfig(lidar=LIDAR),
    "rectangle both ways": RobotConfig(
        radius_m=None,
        footprint_m=((0.25, -0.2), (0.25, 0.2), (-0.25, 0.2), (-0.25, -0.2)),
        max_speed_mps=2.0,
        min_speed_mps=-1.0,
        max_acceleration_mps2=5.0,
        lidar=LIDAR,
    ),
    "sluggish": RobotConfig(
        max_speed_mps=1.0, max_acceleration_mps2=0.5, max_yaw_acceleration_radps2=2.0, lidar=LIDAR
    ),
    "small and fast": RobotConfig(
        radius_m=0.08, max_speed_mps=3.0, max_yaw_rate_radps=3.0, max_acceleration_mps2=4.0, lidar=LIDAR
    ),
}


def arena(rng: np.random.Generator, discs: int = 0) -> World:
    """10 x 10 m between thin walls, with circles, boxes, thin walls and moving discs."""
    low, high = -SIDE_M, SIDE_M
    outer = [[low, low, high, low], [high, low, high, high], [high, high, low, high], [low, high, low, low]]
    at = rng.uniform(low, high, (3, 10, 2))
    turn = rng.uniform(0.0, math.pi, 10)
    halves = rng.uniform(0.1, 0.5, (10, 2))
    walls = np.hstack([at[2], at[2] + 1.2 * np.column_stack([np.cos(turn), np.sin(turn)])])
    runs = np.column_stack(
        [rng.uniform(low, high, (discs, 4)), np.full(discs, 0.25), rng.uniform(0.1, 0.4, discs)]
    )
    return World(
        bounds=(low, low, high, high),
        circles=np.column_stack([at[0], rng.uniform(0.1, 0.4, 10)]),
        polygons=tuple(box(x, y, a, b, yaw) for (x, y), (a, b), yaw in zip(at[1], halves, turn, strict=True)),
        segments=np.vstack([outer, walls[:4]]),
        discs=np.column_stack([runs, rng.uniform(0, 1, discs), np.full(discs, math.inf)]),
    )


def as_bitmap(world: World) -> World:
    """The same place as a map of cells."""
    field = _core.clearance_field(world.native, -SIDE_M, -SIDE_M, SIZE, SIZE, CELL_M, 1.0)
    solid = (field < 0.5 * CELL_M).astype(np.uint8)
    grid = OccupancyGrid(solid=solid, resolution_m=CELL_M, origin=(-SIDE_M, -SIDE_M, 0.0))
    return World(bounds=world.bounds, grid=grid)


def route(world: World, robot: RobotConfig, rng: np.random.Generator) -> Task | None:
    """A task of at least 3 m between random places, with the shortened A* path; None when the draw fails."""
    room_m = robot.circumscribed_radius_m + 0.06
    field = _core.clearance_field(world.native, -SIDE_M, -SIDE_M, SIZE, SIZE, CELL_M, 1.0)
    blocked: NDArray[np.uint8] = (field < room_m).astype(np.uint8)
    free = np.argwhere(field > room_m + 0.1)
    start, goal = (tuple(int(i) for i in free[rng.integers(len(free))]) for _ in range(2))
    cells, length = _core.astar(blocked, (start[0], start[1]), (goal[0], goal[1]))
    if not 3.0 / CELL_M < length < math.inf:
        return None
    path: Array = (_core.shorten_path(blocked, cells)[:, ::-1] + 0.5) * CELL_M - SIDE_M
    pose = (*path[0], float(rng.uniform(-math.pi, math.pi)))
    if _core.clearance(world.native, np.array([pose]), robot.radius_m or 0.0, robot.polygon, 1.0)[0] < 0.05:
        return None
    return a_task(world, start=pose, goal=tuple(path[-1]), path=np.ascontiguousarray(path))


def routes(robot: RobotConfig, count: int, seed: int, discs: int = 0, bitmap: bool = False) -> list[Task]:
    """`count` routes, each in an arena of its own."""
    rng = np.random.default_rng(seed)
    found: list[Task] = []
    while len(found) < count:
        world = arena(rng, discs)
        task = route(as_bitmap(world) if bitmap else world, robot, rng)
        found += [task] if task is not None else []
    return found


def a_fleet(tasks: list[Task], robot: RobotConfig, **values: Any) -> Fleet:
    """Robots whose bases are as their configuration says."""
    config = _core.SimConfig()
    config.search_m = 2.0 * max(config.lookahead_m, local_lookahead_m(robot))
    base: dict[str, Any] = dict(
        acceleration=robot.max_acceleration_mps2,
        yaw_acceleration=robot.max_yaw_acceleration_radps2,
        lag_s=robot.lag_s,
        latency_s=robot.latency_s,
    )
    return Fleet(tasks, robot, config=config, **(base | values))


def drive(fleet: Fleet, steps: int) -> tuple[Array, Array]:
    """(N,) whether each robot reached its goal, and whether it hit anything; a robot stops at either."""
    reached, hit = np.zeros((2, len(fleet.b["active"])), dtype=bool)
    for _ in range(steps):
        fleet.step(fleet.plan())
        active = fleet.b["active"].astype(bool)
        reached |= active & (fleet.b["reached"] == 1)
        hit |= active & (fleet.b["collided"] == 1)
        fleet.b["active"][:] = ~(reached | hit)
        if not fleet.b["active"].any():
            break
    return reached, hit
