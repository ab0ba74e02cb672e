"""ORCA as a robot's own controller: the walkers' rule, told true velocities."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adrl import _core
from adrl.errors import ConfigError
from adrl.planning.local_control import LocalControl, orca_config
from adrl.types import Array, People, RobotConfig, World
from adrl.worlds.shapes import enclosure
from core.fleet import Fleet, a_robot, a_task
from core.orca_twin import avoid_mover, nearest_allowed
from core.routes import ROBOTS

X, Y, VX, VY = range(4)
BOUNDS = (-10.0, -10.0, 10.0, 10.0)
ROBOT = ROBOTS["diffbot"]


def walkers(rng: np.random.Generator, count: int, share: float = 0.5) -> People:
    """Who cross the square about the origin, none near it at first."""
    angles = rng.uniform(-math.pi, math.pi, count) + 2.0 * math.pi * np.arange(count) / count
    starts = rng.uniform(2.5, 4.0, (count, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])
    ends = -starts + rng.uniform(-1.0, 1.0, (count, 2))
    return People(
        routes=tuple(np.array(route) for route in zip(starts, ends, strict=True)),
        radius_m=rng.uniform(0.2, 0.3, count),
        speed_mps=rng.uniform(0.5, 1.4, count),
        share=np.full(count, share),
        reaction_s=np.zeros(count),
        group=np.full(count, -1),
    )


def driven(
    who: People | None,
    robot: RobotConfig = ROBOT,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    goal: tuple[float, float] = (8.0, 0.0),
    **world: Any,
) -> Fleet:
    """A robot that ORCA drives straight to a goal among people."""
    more = {} if who is None else {"people": who}
    task = a_task(World(bounds=BOUNDS, **world), start, goal, **more)
    fleet = Fleet([task], robot, acceleration=3.0, yaw_acceleration=6.0)
    fleet.control = LocalControl(1, robot, orca_config(robot))
    return fleet.reset()


def complex_(row: Array, at: int = 0) -> complex:
    return complex(row[at], row[at + 1])


@pytest.mark.parametrize("seed", range(12))
def test_the_command_leads_into_the_velocity_that_the_twin_finds(seed: int) -> None:
    """The best velocity in all half-planes, by the conversion that is documented."""
    rng = np.random.default_rng(seed)
    who, config = walkers(rng, 5), orca_config(ROBOT)
    fleet = driven(who, start=(0.0, 0.0, rng.uniform(-0.5, 0.5)))
    met = 0
    for _ in range(25):
        pose, twist = fleet.b["pose"][0], fleet.b["twist"][0]
        heading = complex(math.cos(pose[2]), math.sin(pose[2]))
        here = complex_(pose)
        now = fleet.b["people"][0]
        planes = [
            avoid_mover(
                here,
                twist[0] * heading,
                complex_(now[k], X),
                complex_(now[k], VX),
                0.2 + config.space_m + float(who.radius_m[k]),
                config.share if abs(complex_(now[k], VX)) > 0.05 else 1.0,
                config.horizon_s,
                0.1,
            )
            for k in range(len(who))
        ]
        command = fleet.plan()[0]
        # The path is straight, so its point ahead lies so far along it from where the robot is.
        target = complex(pose[0] + config.lookahead_m, 0.0) - here
        best = nearest_allowed(planes, ROBOT.max_speed_mps, target / abs(target) * ROBOT.max_speed_mps)
        clear = all(abs(complex_(now[k]) - here) < 5.2 for k in range(len(who)))
        if best is not None and clear:
            met += 1
            local = best * heading.conjugate()
            turn = math.atan2(local.imag, local.real) / config.turn_s
            most = ROBOT.max_yaw_rate_radps
            assert command[0] == pytest.approx(max(local.real, 0.0), abs=1e-5)
            assert command[1] == pytest.approx(min(max(turn, -most), most), abs=1e-4)
        fleet.step(command)
    assert met > 5


def test_it_is_told_how_fast_everyone_walks() -> None:
    """Before anyone has moved: where they are is the same, where they will be is not."""
    rng = np.random.default_rng(3)
    who = walkers(rng, 4)
    commands = []
    for turn in (1.0, -1.0):
        fleet = driven(who)
        fleet.b["people"][0, :4, VX : VY + 1] *= turn
        commands.append(fleet.plan()[0])
    assert np.abs(commands[0] - commands[1]).max() > 0.05


@pytest.mark.parametrize("seed", range(10))
def test_people_who_do_their_part_are_never_driven_into(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    fleet = driven(walkers(rng, 6), start=(-4.5, 0.0, 0.0), goal=(4.5, 0.0), segments=enclosure(BOUNDS))
    for _ in range(300):
        fleet.step(fleet.plan())
        if fleet.b["reached"][0]:
            break
        assert not fleet.b["at_fault"][0]
    assert fleet.b["reached"][0] or fleet.b["collided"][0]


def test_a_mirrored_scene_mirrors() -> None:
    rng = np.random.default_rng(5)
    who = walkers(rng, 5)
    other = replace(who, routes=tuple(route * (1.0, -1.0) for route in who.routes))
    wall = np.array([(2.0, 0.7, 3.0, 1.2)])
    one = driven(who, start=(0.0, 0.0, 0.3), segments=wall)
    mirror = driven(other, start=(0.0, 0.0, -0.3), segments=wall * (1.0, -1.0, 1.0, -1.0))
    for _ in range(15):
        commands, mirrored = one.plan(), mirror.plan()
        assert_allclose(commands, mirrored * (1.0, -1.0), atol=1e-6)
        one.step(commands)
        mirror.step(mirrored)


def test_in_the_open_it_drives_straight_at_full_speed() -> None:
    fleet = driven(None)
    for _ in range(20):
        fleet.step(fleet.plan())
    assert_allclose(fleet.b["twist"][0], [ROBOT.max_speed_mps, 0.0], atol=1e-9)
    assert_array_equal(fleet.b["pose"][0, 1:], 0.0)


def test_walls_and_pillars_are_kept_off() -> None:
    """Its path leads right through them."""
    obstacles: list[dict[str, Any]] = [
        {"segments": np.array([(2.0, -0.6, 2.0, 0.5)])},
        {"circles": np.array([(2.0, 0.1, 0.5)])},
    ]
    for shapes in obstacles:
        fleet = driven(None, **shapes)
        for _ in range(120):
            fleet.step(fleet.plan())
        assert not fleet.b["collided"][0]


def test_a_car_is_refused() -> None:
    with pytest.raises(ConfigError, match="turn on the spot"):
        orca_config(a_robot(min_turning_radius_m=0.5))


def test_a_robots_own_map_tells_no_velocities() -> None:
    """So the core refuses to drive by it there, and the policy drives with the map alone."""
    import adrl
    from adrl.planning.own_map import OwnMapDriver
    from adrl.planning.replanner_config import ReplannerConfig

    control = LocalControl(1, ROBOT, orca_config(ROBOT))
    driver = OwnMapDriver(1, ROBOT, control, ReplannerConfig())
    driver.restart(np.arange(1), np.array([[3.0, 0.0]]), np.zeros((1, 3)))
    ranges = np.full((1, ROBOT.lidar.num_beams), 6.0, np.float32)
    with pytest.raises(ValueError, match="velocities"):
        driver.commands(ranges, np.zeros((1, 3)), np.zeros((1, 2)), np.ones(1, dtype=bool))
    with pytest.raises(ConfigError, match="guidance replan"):
        adrl.evaluate("orca", guidance="replan", episodes=1)
    assert isinstance(control.native, _core.LocalControl)
