"""Runs a policy on fixed tasks, all robots stepped in one batch, one task a robot."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from adrl.deploy.policies import act, begin, checked_actions
from adrl.envs import Body, NavSim, Setting, simulate
from adrl.envs.steps import Outcome
from adrl.errors import ConfigError, TaskError
from adrl.evaluation.metrics import Episodes
from adrl.evaluation.social import Company
from adrl.observation import Encoder, EncoderConfig, needs_path
from adrl.rewards import RewardConfig, reward
from adrl.rewards.step import step_discounts
from adrl.types import Array, Policy, RobotConfig, Task

F32 = NDArray[np.float32]

CHUNK = 1000
"""Robots stepped at once: bounds the memory of a long evaluation."""


@runtime_checkable
class PrivilegedPolicy(Protocol):
    """A policy that may look behind the sensors, as a planner that knows the map does."""

    def act_in(self, sim: NavSim) -> F32:
        """(N, 2) actions in the simulator's current state."""
        ...


class Recorder(Protocol):
    """Watches a rollout: begin, add after every step, end; then again for the next tasks."""

    @property
    def reward(self) -> RewardConfig | None:
        """The reward whose terms it is shown; None where it shows none."""
        ...

    def begin(self, sim: NavSim, numbers: NDArray[np.int64]) -> None:
        """Robots of the simulator stand at the starts of the tasks with these numbers in their split."""
        ...

    def add(self, sim: NavSim, active: NDArray[np.bool_], outcome: Outcome) -> None:
        """One step of the robots that were driving, (N,) active."""
        ...

    def end(self, ending: NDArray[np.bool_]) -> None:
        """(3, N) which of RATES each robot came to."""
        ...


@dataclass(frozen=True, kw_only=True)
class Rollout:
    """Episodes and, where asked for, the routes driven."""

    episodes: Episodes
    routes: list[Array]
    """One (T, 2) array of positions for each of the recorded tasks."""
    start: F32
    """(E, D) observations of the start states."""
    discounted_return: Array
    """(E,) sum_t gamma^t R_t, t in reference periods; zeros where no rewards were asked for."""
    replans: NDArray[np.int64]
    """(E,) interventions of the replanner in each episode; 0 without guidance `replan`."""


@dataclass(frozen=True, kw_only=True)
class Rewards:
    """What a rollout adds up."""

    config: RewardConfig
    gamma: float
    """Discount a reference period."""
    maturity: float
    """S of the weights (eqs 14-16)."""


def rollout(
    policy: Policy | PrivilegedPolicy,
    tasks: Sequence[Task],
    setting: Setting | RobotConfig | Sequence[Setting],
    *,
    kinds: Sequence[int] | None = None,
    encoder: Encoder | None = None,
    seed: int = 0,
    num_threads: int = 0,
    record: int = 0,
    first_task: int = 0,
    numbers: Sequence[int] | None = None,
    rewards: Rewards | None = None,
    recorders: Sequence[Recorder] = (),
    on_step: Callable[[int, int], None] | None = None,
    body: Body | None = None,
    on_drive: Callable[[NavSim, NDArray[np.int64], NDArray[np.bool_]], None] | None = None,
) -> Rollout:
    """Drive every task once.

    setting: what the robots see and follow; a robot alone drives to the goal. Several, which differ in robot, guidance
    and taken_as, are driven side by side: task i with setting kinds[i]. encoder: of the policy's own, in place of the
    setting's, which sees one robot.
    seed: of the sensors' noise and of odometry drift, nothing else; every policy meets the same. record: number of
    tasks, from the first, whose routes are kept. first_task: number of tasks[0] in its split; numbers: of each, where
    they do not follow each other. rewards: those to add up, if any. recorders: keep the course of episodes.
    on_step(ended, total) is told the progress. body: moves and senses the robots instead of our simulator, as many side
    by side as it has.
    on_drive(sim, numbers, moving) sees each period of the robots (N,) that moved. Raises TaskError for no tasks,
    ConfigError for actions that are none, and for several settings that cannot be driven side by side.
    """
    if not tasks:
        raise TaskError("no tasks to evaluate on; ask for one episode or more")
    parts, routes, starts, returns, replans, done = [], [], [], [], [], 0
    among_people = any(len(task.people) for task in tasks)
    asked = [recorder.reward for recorder in recorders] if rewards is None else [rewards.config]
    shown = next((config for config in asked if config is not None), None)
    settings = _settings(setting, encoder)
    whose = np.zeros(len(tasks), np.intp) if kinds is None else np.asarray(kinds, np.intp)
    in_split = first_task + np.arange(len(tasks)) if numbers is None else np.asarray(numbers, np.int64)
    known = kinds is not None or len(settings) == 1
    if not (known and len(whose) == len(in_split) == len(tasks) and set(whose) <= set(range(len(settings)))):
        raise ConfigError(
            f"there are {len(tasks)} tasks and {len(settings)} settings; say of each task its kind and its number"
        )
    side_by_side = CHUNK if body is None else body.num_envs
    for first in range(0, len(tasks), side_by_side):
        chunk = tasks[first : first + side_by_side]
        rows = slice(first, first + len(chunk))
        used, kind = np.unique(whose[rows], return_inverse=True)
        among = [settings[k] for k in used]
        sim = simulate(among, len(chunk), reward=shown, num_threads=num_threads, body=body)
        own = in_split[rows]
        # Noise and drift of a task depend on the evaluation's seed and the task's number alone.
        streams = [np.random.SeedSequence((seed, int(n))) for n in own]
        seeds = np.array([stream.generate_state(1, np.uint64)[0] for stream in streams])
        drawers = [np.random.default_rng(stream.spawn(1)[0]) for stream in streams]
        sim.reset(np.arange(len(chunk)), chunk, seeds, drawers, kinds=kind)
        keep = max(0, min(record - first, len(chunk)))
        observe = _Eyes(sim, encoder)

        def progress(ended: int, before: int = done) -> None:
            if on_step is not None:
                on_step(before + ended, len(tasks))

        starts.append(observe())
        begin(policy, np.arange(len(chunk)))
        part, kept, earned = _drive(
            policy, sim, observe, own, keep, rewards, recorders, progress, on_drive, among_people
        )
        parts.append(part)
        routes += kept
        returns.append(earned)
        replans.append(
            np.zeros(len(chunk), np.int64) if sim.replanner is None else sim.replanner.replans.copy()
        )
        done += len(chunk)
    return Rollout(
        episodes=_concatenate(parts),
        routes=routes,
        start=np.concatenate(starts),
        discounted_return=np.concatenate(returns),
        replans=np.concatenate(replans),
    )


class _Eyes:
    """What a policy sees of the robots that drive: at those that have ended nobody looks again."""

    def __init__(self, sim: NavSim, encoder: Encoder | None) -> None:
        self._sim, self._encoder = sim, encoder
        self._seen: F32 | None = None

    def __call__(self) -> NDArray[np.floating]:
        """(N, D); the rows of robots that have ended are what was seen before."""
        if self._encoder is not None:
            return self._encoder.encode(*self._sim.measured())
        driving = np.flatnonzero(self._sim.b["active"])
        if self._seen is None or len(driving) == self._sim.num_envs:
            self._seen = self._sim.observe()
        else:
            self._seen = self._seen.copy()  # a policy may have kept the array
            self._seen[driving] = self._sim.observe(driving)
        return self._seen


def _settings(given: Setting | RobotConfig | Sequence[Setting], encoder: Encoder | None) -> Sequence[Setting]:
    settings = [given] if isinstance(given, Setting) else given
    settings = [Setting(robot=settings)] if isinstance(settings, RobotConfig) else settings
    if len(settings) == 0:
        raise ConfigError("there are no settings to drive in; give one or more")
    if encoder is None:
        return settings
    if len(settings) > 1:
        raise ConfigError("a policy with an encoder of its own drives one robot at a time; give one setting")
    return [
        replace(
            settings[0], encoder=EncoderConfig(history_steps=encoder.history_steps, path=needs_path(encoder))
        )
    ]


def _drive(
    policy: Policy | PrivilegedPolicy,
    sim: NavSim,
    observe: Callable[[], NDArray[np.floating]],
    numbers: NDArray[np.int64],
    keep: int,
    rewards: Rewards | None,
    recorders: Sequence[Recorder],
    progress: Callable[[int], None],
    on_drive: Callable[[NavSim, NDArray[np.int64], NDArray[np.bool_]], None] | None,
    among_people: bool,
) -> tuple[dict[str, NDArray[np.generic]], list[Array], Array]:
    n = sim.num_envs
    earned, discount = np.zeros(n), np.ones(n)
    tasks = [task for task in sim.tasks if task is not None]
    ending = np.zeros((3, n), dtype=bool)
    least_clearance = sim.b["least_clearance"].copy()
    turned = np.zeros(n)
    steps = np.zeros(n)
    trace = [sim.b["pose"][:keep, :2].copy()]
    # A start within the goal's tolerance has arrived, a start in contact has hit: neither is driven.
    ending[0], ending[1] = sim.b["reached"], sim.b["collided"] & ~sim.b["reached"].astype(bool)
    sim.b["active"][:] = ~ending.any(axis=0)
    company = Company(sim) if among_people else None
    for recorder in recorders:
        recorder.begin(sim, numbers)
    while sim.b["active"].any():
        active = sim.b["active"].astype(bool)
        before = sim.b["twist"][:, 1].copy()
        outcome = sim.step(_actions(policy, sim, observe))
        for recorder in recorders:
            recorder.add(sim, active, outcome)
        if company is not None:
            company.add(sim, active)
        moving = (
            active & ~outcome.collided
        )  # contact stops a robot at once, which says nothing of its driving
        turned[moving] += np.abs(sim.b["twist"][moving, 1] - before[moving])
        steps[moving] += 1
        if on_drive is not None:
            on_drive(sim, numbers, moving)
        least_clearance[active] = np.minimum(least_clearance, sim.b["least_clearance"])[active]
        if rewards is not None:
            paid = reward(outcome.reward_terms, outcome.features, rewards.maturity, rewards.config)
            earned += discount * active * paid
            discount *= step_discounts(rewards.gamma, sim.periods)
        ending |= np.stack([outcome.reached, outcome.collided, outcome.timed_out]) & active
        sim.b["active"][ending.any(axis=0)] = 0
        trace.append(sim.b["pose"][:keep, :2].copy())
        progress(int(ending.any(axis=0).sum()))
    for recorder in recorders:
        recorder.end(ending)
    distance, time_s = sim.b["travelled"].copy(), sim.b["time"].copy()
    columns = {
        "task": numbers,
        "success": ending[0],
        "collision": ending[1],
        "timeout": ending[2],
        "distance_m": distance,
        "time_s": time_s,
        # An episode ends at the rim of the goal's disc, and so does the path it is measured against.
        "shortest_m": np.array([max(task.shortest_m - task.goal_tolerance_m, 0.0) for task in tasks]),
        "least_clearance_m": least_clearance,
        "mean_speed_mps": distance / np.maximum(time_s, 1e-9),
        "smoothness": turned / np.maximum(steps, 1.0) / sim.rows.robot.control_period_s,
        "start_xy_m": np.array([task.start[:2] for task in tasks]),
        "goal_xy_m": np.array([task.goal for task in tasks]),
        "final_pose": sim.b["pose"].copy(),
    }
    if company is not None:
        columns |= company.columns(sim, columns["shortest_m"])
    path = np.stack(trace)  # (T, keep, 2)
    return columns, [path[: int(steps[i]) + 1, i] for i in range(keep)], earned


def _actions(
    policy: Policy | PrivilegedPolicy, sim: NavSim, observe: Callable[[], NDArray[np.floating]]
) -> F32:
    if isinstance(policy, PrivilegedPolicy):
        return checked_actions(policy, policy.act_in(sim), sim.num_envs)
    return act(policy, observe())


def _concatenate(parts: list[dict[str, NDArray[np.generic]]]) -> Episodes:
    names = [name for name in parts[0] if all(name in part for part in parts)]
    return Episodes(**{name: np.concatenate([part[name] for part in parts]) for name in names})  # pyright: ignore
