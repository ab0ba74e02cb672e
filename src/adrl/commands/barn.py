"""adrl barn."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from adrl import api, files
from adrl.baselines.planners import PLANNERS
from adrl.commands.options import parse, write_document
from adrl.commands.progress import console, counting_bar
from adrl.deploy.policies import ResolvedPolicy, find_policy
from adrl.errors import ConfigError
from adrl.evaluation.barn import BarnRuns, SpeedLimited, reference_table, require_v_max, warning, world_table
from adrl.evaluation.results import require_results_folder, write_table
from adrl.outputs import require_file
from adrl.types import RobotConfig
from adrl.worlds import ROBOTS, BarnScenario
from adrl.worlds.barn import TIME_LIMIT_S
from adrl.worlds.given import fingerprint

JACKAL = ROBOTS["jackal"]


@dataclass(frozen=True, kw_only=True)
class BarnOptions:
    """Which policy drives in which of the benchmark's worlds."""

    worlds: Path
    """Folder of world_N.world and path_N.npy; or of folders worlds and paths, or world_files and path_files."""
    policy: str = "jackal"
    """astar-mppi or another planner, jackal (a shipped policy), a run folder of a policy for the Jackal, or one of your
    own, as adrl evaluate has it."""
    v_max: float | None = None
    """Greatest speed, m/s: faster commands of a policy are cut off here, and a planner plans with it. That of the
    robot when left out."""
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
    threads: int = 0
    """Threads of the simulator; 0 takes one per core."""
    out: Path | None = None
    """Folder for episodes.parquet and summary.json."""
    json: Path | None = None
    """File for the summary; - prints it."""

    def __post_init__(self) -> None:
        if self.trials < 1:
            raise ConfigError(f"trials is {self.trials}; give 1 or more")


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
    policy, robot, v_max_mps = _driver(options)
    scenario = BarnScenario(options.worlds, options.held_out)
    worlds = scenario.split("test")
    seen = policy.training_worlds
    trained_on = [seen is None or fingerprint(world.world) in seen for world in worlds]
    # The benchmark's time limit, not that of training.
    tasks = [
        dataclasses.replace(scenario.task_in(world, robot), time_limit_s=TIME_LIMIT_S) for world in worlds
    ]
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
    runs = BarnRuns(worlds=worlds, episodes=result.rollout.episodes, trained_on=np.array(trained_on))
    about = {"v_max_mps": v_max_mps, "held_out": options.held_out, "trained_on_known": seen is not None}
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


def _driver(options: BarnOptions) -> tuple[ResolvedPolicy, RobotConfig, float]:
    """The policy at v_max, its robot, which must have the Jackal's body, and v_max. Raises AdrlError."""
    policy = find_policy(options.policy, PLANNERS)
    robot = policy.robot or JACKAL
    v_max = robot.max_speed_mps if options.v_max is None else options.v_max
    require_v_max(v_max, robot)
    if robot.footprint_m != JACKAL.footprint_m:
        raise ConfigError(
            f"policy {options.policy!r} drives robot {robot.name!r}, whose body is not the Jackal's of the benchmark; "
            "train with --robot jackal"
        )
    if policy.knows_the_world:
        return policy, dataclasses.replace(robot, max_speed_mps=v_max), v_max
    return dataclasses.replace(policy, policy=SpeedLimited(policy.policy, robot, v_max)), robot, v_max
