"""Random worlds, poses and footprints for the tests of the core; worlds moved and mirrored."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from adrl.types import Array, OccupancyGrid, World
from core.twins import Pose, placed

SIDE_M = 4.0
BOUNDS = (-SIDE_M, -SIDE_M, SIDE_M, SIDE_M)

# Half of the numbers lie on a coarse grid, so that touching, aligned and collinear shapes come up.
coordinates = st.one_of(
    st.floats(-SIDE_M, SIDE_M).map(lambda x: round(x, 6)), st.integers(-8, 8).map(lambda k: 0.5 * k)
)
angles = st.one_of(
    st.floats(-7.0, 7.0).map(lambda a: round(a, 6)), st.integers(-8, 8).map(lambda k: 0.25 * k * math.pi)
)
poses = st.tuples(coordinates, coordinates, angles)
sizes = st.floats(0.05, 1.0).map(lambda x: round(x, 6))


def turn_of(count: int) -> Array:
    """(count,) angles evenly over a full turn from 0."""
    return np.arange(count, dtype=np.float64) * (2.0 * math.pi / count)


def box(x: float, y: float, half_x: float, half_y: float, yaw: float = 0.0) -> Array:
    """(4, 2) corners of a rectangle, counter-clockwise."""
    corners = [(-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y)]
    return np.array([placed((x, y, yaw), corner) for corner in corners])


def stretched_ring(x: float, y: float, half_x: float, half_y: float, yaw: float, corners: int) -> Array:
    """(V, 2) a regular polygon stretched along two axes: convex, counter-clockwise."""
    turns = [2.0 * math.pi * k / corners for k in range(corners)]
    return np.array([placed((x, y, yaw), (half_x * math.cos(a), half_y * math.sin(a))) for a in turns])


polygons = st.one_of(
    st.builds(box, coordinates, coordinates, sizes, sizes, angles),
    st.builds(stretched_ring, coordinates, coordinates, sizes, sizes, angles, st.integers(3, 9)),
)
footprints = st.one_of(
    st.just(np.empty((0, 2))),
    st.builds(lambda a, b: box(0.05, 0.0, a, b), st.floats(0.05, 0.4), st.floats(0.05, 0.3)),
    st.builds(
        lambda a, b, k: stretched_ring(0.0, 0.0, a, b, 0.3, k),
        st.floats(0.1, 0.4),
        st.floats(0.1, 0.4),
        st.integers(3, 8),
    ),
)
"""(0, 2) stands for a disc."""


def _rows(width: int, *columns: st.SearchStrategy, most: int) -> st.SearchStrategy[Array]:
    return st.lists(st.tuples(*columns), max_size=most).map(
        lambda rows: np.array(rows, dtype=float).reshape(-1, width)
    )


circles = _rows(3, coordinates, coordinates, sizes, most=4)
segments = _rows(4, *[coordinates] * 4, most=4)
discs = _rows(
    8,
    *[coordinates] * 4,
    sizes,
    st.floats(0.0, 2.0),
    st.floats(0.0, 0.999),
    st.one_of(st.just(math.inf), st.floats(0.0, 5.0)),
    most=3,
)


@st.composite
def grids(draw: st.DrawFn) -> OccupancyGrid:
    """Small bitmaps anywhere in the arena, turned."""
    height, width = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    cells = draw(st.lists(st.sampled_from([0, 0, 0, 1]), min_size=height * width, max_size=height * width))
    solid = np.array(cells, dtype=np.uint8).reshape(height, width)
    return OccupancyGrid(
        solid=solid, resolution_m=draw(st.sampled_from([0.1, 0.25, 0.5])), origin=draw(poses)
    )


@st.composite
def worlds(draw: st.DrawFn) -> World:
    """Worlds that hold a few obstacles of every kind."""
    return World(
        bounds=BOUNDS,
        circles=draw(circles),
        polygons=tuple(draw(st.lists(polygons, max_size=4))),
        segments=draw(segments),
        discs=draw(discs),
        grid=draw(st.one_of(st.none(), grids())),
    )


def random_world(rng: np.random.Generator, count: int = 12) -> World:
    """A world of `count` circles and as many boxes, segments and moving discs; no bitmap."""
    place = rng.uniform(-SIDE_M, SIDE_M, (4, count, 4))
    size = rng.uniform(0.05, 0.5, (count, 2))
    motion = np.column_stack([size[:, 0], rng.uniform(0, 1, (count, 2)), np.full(count, math.inf)])
    return World(
        bounds=BOUNDS,
        circles=np.column_stack([place[0, :, :2], size[:, 0]]),
        polygons=tuple(box(x, y, a, b, yaw) for (x, y, yaw, _), (a, b) in zip(place[1], size, strict=True)),
        segments=place[2],
        discs=np.column_stack([place[3], motion]),
    )


def moved(world: World, by: Pose) -> World:
    """The same world seen from elsewhere: every point p becomes the point p of the frame `by`."""

    def shift(points: Array) -> Array:
        return np.array([placed(by, (x, y)) for x, y in points]).reshape(-1, 2)

    return replace(
        world,
        circles=np.column_stack([shift(world.circles[:, :2]), world.circles[:, 2:]]),
        polygons=tuple(shift(polygon) for polygon in world.polygons),
        segments=np.column_stack([shift(world.segments[:, :2]), shift(world.segments[:, 2:])]),
        discs=np.column_stack([shift(world.discs[:, :2]), shift(world.discs[:, 2:4]), world.discs[:, 4:]]),
        grid=world.grid and replace(world.grid, origin=moved_pose(world.grid.origin, by)),
    )


def moved_pose(pose: Pose, by: Pose) -> Pose:
    """A pose of the frame `by`, in the world."""
    return *placed(by, pose[:2]), pose[2] + by[2]


def mirrored(world: World) -> World:
    """The world with left and right exchanged: every point (x, y) becomes (x, -y)."""
    flip = np.array([1.0, -1.0])
    grid = world.grid
    if grid is not None:
        x, y = placed(grid.origin, (0.0, grid.solid.shape[0] * grid.resolution_m))
        solid = np.ascontiguousarray(grid.solid[::-1])
        grid = replace(grid, solid=solid, origin=(x, -y, -grid.origin[2]))
    return replace(
        world,
        circles=world.circles * [1.0, -1.0, 1.0],
        polygons=tuple((polygon * flip)[::-1] for polygon in world.polygons),
        segments=world.segments * [1.0, -1.0, 1.0, -1.0],
        discs=world.discs * [1.0, -1.0, 1.0, -1.0, 1.0, 1.0, 1.0, 1.0],
        grid=grid,
    )
