"""A robot that its supervisor holds gets on, touches nothing, and is left alone when nothing holds it."""

import math

import numpy as np
import pytest

from adrl.deploy import MlpPolicy, recovery
from adrl.observation import to_action
from adrl.types import Task, World
from adrl.worlds import ROBOTS
from deploy.closed_loop import obstacle_course
from deploy.faulty_loop import Loop
from deploy.recorded import a_policy

ROBOT = ROBOTS["diffbot"]


def asks_for(v: float, w: float) -> MlpPolicy:
    """A policy that wants the same for ever."""
    shipped = a_policy(ROBOT)
    layers = list(shipped.layers)
    weight, bias = layers[-1]
    action = to_action(np.array([[v, w]]), ROBOT)[0].astype(np.float64)
    layers[-1] = (
        np.zeros_like(weight),
        np.arctanh(np.clip(action, -1 + 1e-12, 1 - 1e-12)).astype(bias.dtype),
    )
    return MlpPolicy(layers, shipped.config)


def task_in(world: World) -> Task:
    """Its goal is far away, whatever stands between."""
    start, goal = (0.0, 0.0, 0.0), (99.0, 0.0)
    path = np.array([start[:2], goal])
    return Task(world=world, start=start, goal=goal, path=path, shortest_m=99.0, time_limit_s=1e9)


def beside_a_pillar(clear_m: float) -> Task:
    """The pillar stands to the right, a little ahead."""
    away, bearing = 0.15 + 0.2 + clear_m, math.radians(-75.0)
    pillar = [away * math.cos(bearing), away * math.sin(bearing), 0.15]
    return task_in(World(bounds=(-3, -3, 6, 3), circles=np.array([pillar])))


def driven(policy: MlpPolicy, *tasks: Task, seconds: float = 15.0) -> tuple[Loop, set[str]]:
    """Guidance is the goal alone. The loop at its end, and the reasons that were given."""
    loop, reasons = Loop(tasks, ROBOT, guidance="goal", policy=policy), set()
    for _ in range(round(10 * seconds)):
        loop.run(1)
        reasons |= {reason for command in loop.commands if command is not None for reason in command.reasons}
    return loop, reasons


@pytest.mark.parametrize(("patience_s", "passes"), [(math.inf, False), (recovery.PATIENCE_S, True)])
def test_a_policy_that_hugs_a_pillar_passes_it(
    patience_s: float, passes: bool, monkeypatch: pytest.MonkeyPatch
):
    """It asks for straight on, which the supervisor cannot grant; without help the robot stands for ever."""
    monkeypatch.setattr(recovery, "PATIENCE_S", patience_s)
    loop, reasons = driven(asks_for(0.5, 0.0), beside_a_pillar(0.01))
    assert (loop.sim.b["travelled"][0] > 1.0) == passes
    assert ("recovering" in reasons) == passes
    assert not loop.hit.any()


def test_turning_on_the_spot_is_left_alone():
    loop, reasons = driven(asks_for(0.0, 0.8), beside_a_pillar(0.01))
    assert not reasons & {"recovering", "obstacle"}
    assert loop.sim.b["travelled"][0] < 0.05


def test_without_a_free_way_it_waits():
    """Pillars all round, too near to each other to pass between."""
    angles = np.arange(8) * math.pi / 4
    ring = np.stack([0.4 * np.cos(angles), 0.4 * np.sin(angles), np.full(8, 0.1)], axis=1)
    ringed = task_in(World(bounds=(-3, -3, 6, 3), circles=ring))
    loop, reasons = driven(asks_for(0.5, 0.0), ringed)
    assert "obstacle" in reasons
    assert "recovering" not in reasons
    assert not loop.hit.any()


def test_among_obstacles_it_touches_nothing_and_gets_about(monkeypatch: pytest.MonkeyPatch):
    """Straight on for ever, in full yards: without it each robot ends at the first obstacle."""
    rng = np.random.default_rng(0)
    tasks = [task_in(obstacle_course(rng, 0.6)) for _ in range(8)]
    way_m = []
    for patience_s in (math.inf, recovery.PATIENCE_S):
        monkeypatch.setattr(recovery, "PATIENCE_S", patience_s)
        loop, _ = driven(asks_for(0.5, 0.0), *tasks, seconds=60.0)
        assert not loop.hit.any()
        way_m.append(loop.sim.b["travelled"].copy())
    assert (way_m[1] > way_m[0] + 0.5).all(), way_m
