"""adrl barn."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from adrl import api, files
from adrl.baselines.planners import PLANNERS
from adrl.commands.options import parse, write_document
from adrl.commands.progress import console, counting_bar
from adrl.deploy.policies import ResolvedPolicy, find_policy
from adrl.errors import ConfigError
from adrl.evaluation.barn import BarnRuns, SpeedLimited, reference_table, require_v_max, warning, world_table
from adrl.evaluation.results import require_results_folder, write_table
from adrl.outputs import require_file
from adrl.types import RobotConfig, Task
from adrl.worlds import ROBOTS, BarnScenario
from adrl.worlds.barn import TIME_LIMIT_S, BarnWorld
from adrl.worlds.given import fingerprint

JACKAL = ROBOTS["jackal"]


@dataclass(frozen=True, kw_only=True)
class BarnDrives:
    """Which policy drives in which of the benchmark's worlds."""

    worlds: Path
    """Folder of world_N.world and path_N.npy; or of folders worlds and paths, or world_files and path_files."""
    policy: str = "jackal"
    """astar-mppi or another planner, jackal (a shipped policy), a run folder of a policy for the Jackal, or one of your
    own, as adrl evaluate has it."""
    v_max: float | None = None
    """Greatest speed, m/s: faster commands of a policy are cut off here, and a planner plans with it. That of the
    robot when left out; a policy of a family drives no faster than it does elsewhere."""
    held_out: int = 0
    """Drive only so many of the worlds, those that training with the same --barn and --barn-held-out leaves out; 0 for
    all. Worlds that the policy was trained on are told by what stands in them, and marked, whatever is given here."""
    guidance: Literal["goal", "replan", "map"] | None = None
    """goal: the policy sees the final goal; replan: the same, and waypoints of its own map when blocked; map:
    a waypoint on the A* path of the known map, which the benchmark does not give. As trained when left out."""
    trials: int = 10
    """Runs in each world; they differ in the sensors' noise."""
    seed: int = 0
    """Of that noise."""
    json: Path | None = None
    """File for the summary; - prints it."""

    def __post_init__(self) -> None:
        if self.trials < 1:
            raise ConfigError(f"trials is {self.trials}; give 1 or more")

    def driver(self) -> tuple[ResolvedPolicy, RobotConfig, float]:
        """The policy at v_max, its robot, which must have the Jackal's body, and v_max. Raises AdrlError."""
        policy = find_policy(self.policy, PLANNERS)
        robot = policy.robot or JACKAL
        v_max = robot.max_speed_mps if self.v_max is None else self.v_max
        require_v_max(v_max, robot)
        if robot.footprint_m != JACKAL.footprint_m:
            raise ConfigError(
                f"policy {self.policy!r} drives robot {robot.name!r}, whose body is not the Jackal's of the "
                "benchmark; train with --robot jackal"
            )
        if policy.knows_the_world:
            return policy, dataclasses.replace(robot, max_speed_mps=v_max), v_max
        # Its actions are shares of what the policy takes the robot's speeds for.
        known = policy.taken_as(robot)
        limited = SpeedLimited(policy.policy, known, min(v_max, known.max_speed_mps))
        return dataclasses.replace(policy, policy=limited), robot, v_max


@dataclass(frozen=True, kw_only=True)
class BarnOptions(BarnDrives):
    """How it is driven in our simulator, and where the results go."""

    threads: int = 0
    """Threads of the simulator; 0 takes one per core."""
    out: Path | None = None
    """Folder for episodes.parquet and summary.json."""


def benchmark_task(scenario: BarnScenario, world: BarnWorld, robot: RobotConfig) -> Task:
    """With the benchmark's time limit, not that of training. Raises TaskError."""
    return dataclasses.replace(scenario.task_in(world, robot), time_limit_s=TIME_LIMIT_S)


def trained_on(policy: ResolvedPolicy, worlds: Sequence[BarnWorld]) -> NDArray[np.bool_]:
    """(W,) whether the policy was trained in each world; in all where it does not say."""
    seen = policy.training_worlds
    return np.array([seen is None or fingerprint(world.world) in seen for world in worlds])


def main(arguments: Sequence[str]) -> int:
    """Drive the benchmark and print its tables."""
    options = parse(
        BarnOptions,
        arguments,
        "barn",
        "Drive a policy in worlds of the BARN navigation benchmark, with its start, goal, time limit and score: "
        "success * OT / clip(AT, 2 OT, 8 OT), at most 0.5.",
    )
    require_results_folder("--out", options.out)
    require_file("--json", options.json)
    policy, robot, v_max_mps = options.driver()
    scenario = BarnScenario(options.worlds, options.held_out)
    worlds = scenario.split("test")
    tasks = [benchmark_task(scenario, world, robot) for world in worlds]
    with counting_bar(f"driving {options.policy}", "runs") as show:
        result = api.evaluate(
            policy,
            scenario=scenario,
            robot=robot,
            guidance=options.guidance,
            seed=options.seed,
            num_threads=options.threads,
            tasks=tasks * options.trials,
            on_step=show,
        )
    runs = BarnRuns(worlds=worlds, episodes=result.rollout.episodes, trained_on=trained_on(policy, worlds))
    about = {"v_max_mps": v_max_mps, "held_out": options.held_out}
    about |= {"trained_on_known": policy.training_worlds is not None}
    summary = result.summary | about | runs.summary()
    console().print(world_table(summary))
    console().print(reference_table(summary))
    for line in summary["warnings"]:
        console().print(f"WARNING: {line}", style="bold", markup=False, highlight=False)
    if (line := warning(summary)) is not None:
        console().print(line, style="bold", markup=False, highlight=False)
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        write_table(options.out / "episodes.parquet", runs.to_table())
        files.write_json(options.out / "summary.json", summary)
    write_document(options.json, summary)
    return 0
