"""Pictures: the right pixels at the right place, and a window that keeps itself up to date."""

import dataclasses
import sys

import numpy as np
import pytest
from numpy.typing import NDArray

from adrl.envs import NavEnv, NavVectorEnv
from adrl.envs.render import DISC, FREE, GOAL, ROBOT, SIZE_PX, SOLID, WAYPOINT, View
from adrl.errors import MissingExtra
from adrl.types import OccupancyGrid, Task, World
from adrl.worlds import ROBOTS
from env_tasks import OneTask, room

Picture = NDArray[np.uint8]
FORWARD = np.array([1.0, 0.3], dtype=np.float32)


def colour_at(picture: Picture, world: World, x: float, y: float) -> tuple[int, ...]:
    ((column, row),) = View(world).pixels((x, y))
    return tuple(picture[int(row), int(column)])


def centre_of(picture: Picture, world: World, colour: tuple[int, int, int]) -> tuple[float, float]:
    """Mean place in metres of the pixels of one colour."""
    rows, columns = np.nonzero((picture == colour).all(axis=-1))
    assert len(rows) > 0
    x, y = View(world).metres()[rows, columns].mean(axis=0)
    return float(x), float(y)


def furnished() -> World:
    grid = OccupancyGrid(solid=np.ones((4, 6), np.uint8), resolution_m=0.25, origin=(3.0, -5.0, 0.4))
    box = np.array([[1.0, 2.0], [2.0, 2.0], [2.0, 3.0], [1.0, 3.0]])
    base = room(circles=[(0.0, -3.0, 0.5)], segments=[(-4.0, 2.0, -2.0, 4.0)])
    disc = np.array([[-4.0, -4.0, -2.0, -4.0, 0.3, 0.5, 0.25, np.inf]])
    return dataclasses.replace(base, polygons=(box,), grid=grid, discs=disc)


def task_in(world: World) -> Task:
    path = np.array([[-2.0, 0.0], [3.0, 0.5]])
    return Task(
        world=world, start=(-2.0, 0.0, 0.5), goal=(3.0, 0.5), path=path, shortest_m=5.03, time_limit_s=30.0
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_robot_is_drawn_where_it_is(name: str) -> None:
    robot = ROBOTS[name]
    world = furnished()
    env = NavEnv(scenario=OneTask(task_in(world)), robot=robot, render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(15):
        env.step(FORWARD)
        picture = env.render()
        assert picture is not None
        assert picture.shape == (SIZE_PX, SIZE_PX, 3)
        assert picture.dtype == np.uint8
        x, y, theta = env._env.sim.b["pose"][0]
        pixel_m = 1.0 / View(world).scale
        # Beside the nose line, within the footprint of the smallest robot.
        side = 2.5 * pixel_m
        assert colour_at(picture, world, x - side * np.sin(theta), y + side * np.cos(theta)) == ROBOT
        assert np.hypot(*np.subtract(centre_of(picture, world, ROBOT), (x, y))) < 2.0 * pixel_m
        drawn_m2 = (picture == ROBOT).all(axis=-1).sum() * pixel_m**2
        area_m2 = 0.508 * 0.43 if robot.radius_m is None else np.pi * robot.radius_m**2
        assert 0.5 * area_m2 < drawn_m2 < 1.5 * area_m2


def test_geometry_is_drawn_where_the_lidar_sees_it() -> None:
    """Circle, box, wall, bitmap (turned), moving disc, goal: each at its place, free space elsewhere."""
    world = furnished()
    env = NavEnv(scenario=OneTask(task_in(world)), render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    assert picture is not None
    grid_centre = np.array([0.75, 0.5])
    c, s = np.cos(0.4), np.sin(0.4)
    in_grid = (3.0 + c * grid_centre[0] - s * grid_centre[1], -5.0 + s * grid_centre[0] + c * grid_centre[1])
    for place in [(0.0, -3.0), (1.5, 2.5), (-3.0, 3.0), in_grid]:
        assert colour_at(picture, world, *place) == SOLID
    assert colour_at(picture, world, -3.0, -4.0) == DISC  # a quarter of the round trip: half way
    assert np.hypot(*np.subtract(centre_of(picture, world, GOAL), (3.0, 0.5))) < 0.05
    for place in [(0.0, 4.0), (4.5, 3.0), (2.2, -4.9)]:
        assert colour_at(picture, world, *place) == FREE


def test_discs_are_drawn_as_the_core_moves_them() -> None:
    """Whatever the time: the clearance at the drawn centre is minus the radius or less."""
    from adrl import _core

    world = furnished()
    for time_s in np.linspace(0.0, 20.0, 41):
        ((x, y),), radius = world.disc_centres(float(time_s)), world.discs[0, 4]
        poses = np.array([[x + 0.5, y, 0.0], [x, y + 0.5, 0.0]])
        gaps = _core.clearance(world.native, poses, 1e-9, np.empty((0, 2)), 1.0, float(time_s))
        np.testing.assert_allclose(gaps, 0.5 - radius, atol=1e-6)


def test_waypoint_is_drawn_with_guidance_map_only() -> None:
    world = furnished()
    for guidance, drawn in (("goal", False), ("map", True)):
        env = NavEnv(scenario=OneTask(task_in(world)), guidance=guidance, render_mode="rgb_array")
        env.reset(seed=0)
        assert (env.render() == WAYPOINT).all(axis=-1).any() == drawn


def test_vector_env_renders_a_picture_a_robot() -> None:
    env = NavVectorEnv(3, render_mode="rgb_array")
    assert [picture.shape for picture in env.render() or ()] == [
        (SIZE_PX, SIZE_PX, 3)
    ] * 3  # before the first reset
    env.reset(seed=0)
    pictures = env.render()
    assert pictures is not None
    assert len({picture.tobytes() for picture in pictures}) == 3
    assert NavVectorEnv(3).render() is None


def test_human_mode_shows_every_step() -> None:
    pygame = pytest.importorskip("pygame")
    env = NavEnv(scenario=OneTask(task_in(furnished())), render_mode="human")
    twin = NavEnv(scenario=OneTask(task_in(furnished())), render_mode="rgb_array")
    env.reset(seed=0)
    twin.reset(seed=0)
    for _ in range(3):
        shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
        np.testing.assert_array_equal(shown, twin.render())
        env.step(FORWARD)
        twin.step(FORWARD)
    assert env.render() is None
    env.close()
    env.close()
    assert not pygame.display.get_init()


def test_human_mode_without_pygame_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(MissingExtra, match="adrl\\[render\\]"):
        NavEnv(render_mode="human").reset(seed=0)
