"""The BARN benchmark's score of runs, and the table of a set of worlds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adrl.deploy.policies import act, begin, name_of
from adrl.errors import ConfigError
from adrl.evaluation.metrics import Episodes
from adrl.evaluation.results import plain_table
from adrl.evaluation.statistics import bootstrap_mean
from adrl.types import Policy, RobotConfig

if TYPE_CHECKING:
    import pyarrow as pa
    from rich.table import Table

    from adrl.envs import NavSim
    from adrl.worlds.barn import BarnWorld

Array = NDArray[np.float64]
F32 = NDArray[np.float32]


CLOCK_STARTS_M = 0.1
"""The benchmark's clock starts when the robot is so far from its start."""


@dataclass(frozen=True, kw_only=True)
class Reference:
    """A published row: Gazebo runs of others on this benchmark."""

    policy: str
    v_max_mps: float | None
    success: float
    score: float | None


REFERENCES = (
    Reference(policy="DWA", v_max_mps=0.5, success=0.85, score=0.159),
    Reference(policy="end-to-end TD3, trained on these 50", v_max_mps=None, success=0.65, score=None),
    Reference(policy="DRL-VO (PPO)", v_max_mps=None, success=0.936, score=0.372),
    Reference(policy="LiCS (imitation)", v_max_mps=None, success=0.98, score=0.489),
)


def scores(success: ArrayLike, time_s: ArrayLike, optimal_time_s: ArrayLike) -> Array:
    """(E,) score of each run: success * OT / clip(AT, 2 OT, 8 OT), between 0.5 at twice the optimal time and 0.125.

    AT counts from the start of the episode, where no BenchmarkClock has timed it.
    """
    optimal = np.asarray(optimal_time_s, dtype=np.float64)
    return np.asarray(success) * optimal / np.clip(time_s, 2.0 * optimal, 8.0 * optimal)


class BenchmarkClock:
    """The benchmark's clock, which starts when a robot has moved 0.1 m. rollout() takes it as on_drive.

    Of the period in which that happens all counts.
    """

    def __init__(self) -> None:
        self._began_s: dict[int, float] = {}

    def __call__(self, sim: "NavSim", numbers: NDArray[np.int64], moving: NDArray[np.bool_]) -> None:
        """A period of the robots (N,) that moved, on the tasks of these numbers (N,)."""
        for i in np.flatnonzero(moving):
            task, number = sim.tasks[i], int(numbers[i])
            assert task is not None
            way = sim.b["pose"][i, :2] - task.start[:2]
            if number not in self._began_s and float(np.hypot(*way)) >= CLOCK_STARTS_M:
                period_s = float(sim.rows.robot.control_period_s[i])
                self._began_s[number] = float(sim.b["time"][i]) - period_s

    def timed(self, episodes: Episodes) -> Episodes:
        """The episodes with its times; a robot that never moved so far has that of the episode."""
        began_s = np.array([self._began_s.get(int(number), 0.0) for number in episodes.task])
        return replace(episodes, time_s=np.maximum(episodes.time_s - began_s, 0.0))


def require_v_max(v_max_mps: float, robot: RobotConfig) -> None:
    """Raises ConfigError for a limit that the robot's own makes void, or that stops it."""
    if not 0.0 < v_max_mps <= robot.max_speed_mps:
        raise ConfigError(
            f"v_max is {v_max_mps} m/s; give more than 0 and at most the {robot.max_speed_mps} m/s of robot "
            f"{robot.name!r}"
        )


class SpeedLimited:
    """A policy whose speed commands are cut off at v_max; it sees how fast it drives, so this is nothing new to it.

    robot: the one it drives. Raises ConfigError: see require_v_max.
    """

    def __init__(self, policy: Policy, robot: RobotConfig, v_max_mps: float) -> None:
        require_v_max(v_max_mps, robot)
        self.name = name_of(policy)
        self._policy = policy
        span_mps = robot.max_speed_mps - robot.min_speed_mps
        self._most = np.float32(2.0 * (v_max_mps - robot.min_speed_mps) / span_mps - 1.0)

    def reset(self, rows: NDArray[np.intp]) -> None:
        """Episodes of robots `rows` (M,) begin."""
        begin(self._policy, rows)

    def act(self, observation: NDArray[np.floating]) -> F32:
        """(N, D) observations -> (N, 2) actions in [-1, 1]: speed, yaw rate. Raises ConfigError."""
        actions = act(self._policy, observation)
        return np.column_stack([np.minimum(actions[:, 0], self._most), actions[:, 1]])


@dataclass(frozen=True, eq=False, kw_only=True)
class BarnRuns:
    """Runs of one policy: episode i was trial i // W in world i % W of the W."""

    worlds: Sequence["BarnWorld"]
    episodes: Episodes
    trained_on: NDArray[np.bool_]
    """(W,) whether the policy was trained in the world."""

    @property
    def trials(self) -> int:
        """Runs in each world."""
        return len(self.episodes) // len(self.worlds)

    @property
    def optimal_time_s(self) -> Array:
        """(E,) OT of each run."""
        return np.tile([world.optimal_time_s for world in self.worlds], self.trials)

    @property
    def scores(self) -> Array:
        """(E,) score of each run."""
        return scores(self.episodes.success, self.episodes.time_s, self.optimal_time_s)

    def by_world(self, values: ArrayLike) -> Array:
        """(E,) -> (W,) means over the trials of each world."""
        return np.asarray(values, dtype=np.float64).reshape(self.trials, len(self.worlds)).mean(axis=0)

    def rows(self) -> list[dict[str, Any]]:
        """One row a world."""
        episodes = self.episodes
        means = {name: self.by_world(getattr(episodes, name)) for name in ("success", "collision", "timeout")}
        means["score"] = self.by_world(self.scores)
        arrived = self.by_world(episodes.success * episodes.time_s)
        rows = []
        for i, world in enumerate(self.worlds):
            row = {"world": world.number, "trained_on": bool(self.trained_on[i])}
            row |= {"path_m": world.path_m, "optimal_time_s": world.optimal_time_s}
            row |= {name: float(mean[i]) for name, mean in means.items()}
            share = means["success"][i]
            rows.append(row | {"time_s": float(arrived[i] / share) if share > 0.0 else None})
        return rows

    def summary(self) -> dict[str, Any]:
        """Success, endings and score of all worlds, each with _low and _high, the rows, and the same apart for the
        worlds that training never saw and for those that it had; None where there is no such world.
        """
        entries = {"trials": self.trials} | self._estimates(np.ones(len(self.worlds), dtype=bool))
        for part, chosen in (("unseen", ~self.trained_on), ("trained_on", self.trained_on)):
            entries[part] = self._estimates(chosen) if chosen.any() else None
        return entries | {"per_world": self.rows()}

    def _estimates(self, chosen: NDArray[np.bool_]) -> dict[str, Any]:
        """Over the chosen worlds (W,), with bootstrap intervals over worlds: trials in one world are alike."""
        count = int(chosen.sum())
        entries: dict[str, Any] = {"worlds": count}
        columns = {name: getattr(self.episodes, name) for name in ("success", "collision", "timeout")}
        for name, values in (columns | {"score": self.scores}).items():
            estimate, low, high = bootstrap_mean(self.by_world(values)[chosen])
            ends = (low, high) if count > 1 else (None, None)
            entries |= {name: estimate, f"{name}_low": ends[0], f"{name}_high": ends[1]}
        return entries

    def to_table(self) -> "pa.Table":
        """The episodes' table with the columns world, trial, trained_on, optimal_time_s and score."""
        import pyarrow as pa

        table, count = self.episodes.to_table(), len(self.worlds)
        columns = {
            "world": np.tile([world.number for world in self.worlds], self.trials),
            "trial": np.repeat(np.arange(self.trials), count),
            "trained_on": np.tile(self.trained_on, self.trials),
            "optimal_time_s": self.optimal_time_s,
            "score": self.scores,
        }
        for name, column in columns.items():
            table = table.append_column(name, pa.array(column))
        return table


HEADINGS = (
    "world",
    "trained\non",
    "path\nm",
    "OT\ns",
    "success\n%",
    "collision\n%",
    "timeout\n%",
    "Av.T\ns",
    "score\n",
)


def world_table(summary: Mapping[str, Any]) -> "Table":
    """A rich table, one row a world."""
    table = plain_table(
        f"{summary['policy']}, guidance {summary['guidance']}, v_max {summary['v_max_mps']:g} m/s, "
        f"trials a world: {summary['trials']}"
    )
    for heading in HEADINGS:
        table.add_column(heading, justify="right")
    for row in summary["per_world"]:
        rates = (f"{100 * row[name]:.0f}" for name in ("success", "collision", "timeout"))
        time_s = "-" if row["time_s"] is None else f"{row['time_s']:.1f}"
        table.add_row(
            str(row["world"]),
            "yes" if row["trained_on"] else "no",
            f"{row['path_m']:.2f}",
            f"{row['optimal_time_s']:.2f}",
            *rates,
            time_s,
            f"{row['score']:.3f}",
        )
    return table


def reference_table(summary: Mapping[str, Any]) -> "Table":
    """A rich table: ours with intervals, in worlds that training never saw and in those that it had, and the published
    rows.
    """
    table = plain_table(f"trials a world: {summary['trials']}; intervals over worlds")
    table.add_column("policy")
    for heading in ("v_max\nm/s", "success\n%", "score\n"):
        table.add_column(heading, justify="right")
    for part, text in (("unseen", "worlds never trained on"), ("trained_on", "worlds TRAINED ON")):
        mine = summary[part]
        if mine is not None:
            success, score = (
                _with_ends(mine, *column) for column in (("success", 100.0, 1), ("score", 1.0, 3))
            )
            table.add_row(
                f"{summary['policy']}\n{mine['worlds']} {text}", f"{summary['v_max_mps']:g}", success, score
            )
    for row in REFERENCES:
        table.add_row(
            row.policy,
            "-" if row.v_max_mps is None else f"{row.v_max_mps:g}",
            f"{100 * row.success:.1f}",
            "-" if row.score is None else f"{row.score:.3f}",
            style="dim",
        )
    return table


def warning(summary: Mapping[str, Any]) -> str | None:
    """A line for a score that is not of worlds that training never saw; None for one that is."""
    policy, mine, count = summary["policy"], summary["trained_on"], summary["worlds"]
    if mine is None:
        return None
    if not summary["trained_on_known"]:
        return (
            f"Not a held-out score: the run of {policy} does not say which worlds it had; all count as seen."
        )
    if summary["unseen"] is None:
        return f"Not a held-out score: {policy} was trained on every one of these worlds."
    return f"{policy} was trained on {mine['worlds']} of these {count} worlds; only the others' score is held out."


def _with_ends(summary: Mapping[str, Any], name: str, scale: float, decimals: int) -> str:
    estimate, low, high = (summary[name + suffix] for suffix in ("", "_low", "_high"))
    text = f"{scale * estimate:.{decimals}f}"
    return text if low is None else f"{text} [{scale * low:.{decimals}f}, {scale * high:.{decimals}f}]"
