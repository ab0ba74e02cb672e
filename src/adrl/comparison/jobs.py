"""A job of a comparison: train one method with one seed, evaluate its final policy, leave the result."""

import re
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import crc32

from adrl import api, files
from adrl.agents.budget import BudgetSpent
from adrl.agents.checkpoint import FOLDER as CHECKPOINT_FOLDER
from adrl.agents.metrics import METRICS_FILE
from adrl.baselines import SB3_METHODS
from adrl.baselines.planners import PLANNERS
from adrl.comparison.config import CompareConfig
from adrl.deploy.policies import ResolvedPolicy, find_policy
from adrl.deploy.policy import CONFIG_FILE
from adrl.evaluation.metrics import Episodes
from adrl.evaluation.results import write_table
from adrl.runs import Run, RunConfig, train
from adrl.worlds import RobotFamily

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA_VERSION = 1
RESULT_FILE = "summary.json"
EPISODES_FILE = "episodes.parquet"
ROUTES_FILE = "routes.parquet"
RUNS_FOLDER = "runs"


@dataclass(frozen=True)
class Job:
    """One training and its evaluation. seed None: a planner, or another policy that is evaluated only: method is what
    it was called in the configuration."""

    method: str
    seed: int | None

    @property
    def name(self) -> str:
        """Of its folder: no other job has it."""
        if self.seed is not None:
            return f"{self.method}-s{self.seed}"
        readable = re.sub(r"[^\w.-]+", "-", self.method)
        # Paths may differ in what is left out, or look like a training of ours.
        is_plain = readable == self.method and not re.search(r"-s\d+$", readable)
        return readable if is_plain else f"{readable}-{crc32(self.method.encode()):08x}"


def all_jobs(config: CompareConfig) -> list[Job]:
    """The reference, policies that are not trained, then all methods with the first seed, all with the second, ...

    So a slow hour of the machine hits all methods alike, and a part of the results is a fair one.
    """
    first = config.learner.seed
    trainings = [Job(m, s) for s in range(first, first + config.seeds) for m in config.method_names]
    return [*(Job(policy, None) for policy in config.policy_names), *trainings]


def is_finished(config: CompareConfig, job: Job) -> bool:
    """Whether the job's result is there."""
    return (config.out / job.name / RESULT_FILE).exists()


def run_job(config: CompareConfig, job: Job, started_s: float) -> None:
    """Train, or go on with what a killed process left, evaluate, and write the result, the summary last.

    The first seed of each method also leaves a folder GUIDANCE as adrl evaluate --out does.

    started_s: of time.monotonic(); the budget counts from there. Raises AdrlError.
    """
    run = None if job.seed is None else config.out / RUNS_FOLDER / job.name
    if run is not None and job.seed is not None:
        _train(config.run(job.method, job.seed, run), job.method, run, started_s)
    folder = config.out / job.name
    # Traces take megabytes: kept of the planner and of one seed a method, for adrl report.
    traced = job.seed in (None, config.learner.seed)
    policy = find_policy(job.method if run is None else run, PLANNERS)
    under = _own_guidances(policy, config) if run is None else config.guidance_names
    evaluations = [
        _evaluation(config, policy, guidance, folder / guidance if traced else None) for guidance in under
    ]
    method = job.method if run is not None else policy.name
    tables = [
        _table(_episodes(result), method, job.seed, result.summary["guidance"]) for result in evaluations
    ]
    write_table(folder / EPISODES_FILE, concatenated(tables))
    if config.routes:
        alone = [result for result in evaluations if isinstance(result, api.Evaluation)]
        write_table(folder / ROUTES_FILE, _routes(alone))
    if run is not None:
        for name in (METRICS_FILE, CONFIG_FILE):
            files.atomic_write_bytes(folder / name, (run / name).read_bytes())
    summary = {"schema_version": SCHEMA_VERSION, "method": method, "seed": job.seed}
    files.write_json(
        folder / RESULT_FILE, summary | {"evaluations": [result.summary for result in evaluations]}
    )
    if run is not None and not config.keep_checkpoints:
        shutil.rmtree(run / CHECKPOINT_FOLDER, ignore_errors=True)


def _evaluation(
    config: CompareConfig, policy: ResolvedPolicy, guidance: str, out: Path | None
) -> api.Evaluation | api.FamilyEvaluation:
    """Of a policy on the tasks of all, with the robot, or with robots of the family."""
    given: dict[str, Any] = {
        "scenario": config.load(),
        "guidance": guidance,
        "split": config.split,
        "num_threads": 1,
        "out": out,
        **config.shared_tasks,
    }
    if isinstance(config.driven, RobotFamily):
        return api.evaluate_family(policy, family=config.driven, **given)
    return api.evaluate(policy, robot=config.driven, record=config.routes, **given)


def _episodes(result: api.Evaluation | api.FamilyEvaluation) -> Episodes:
    return result.rollout.episodes if isinstance(result, api.Evaluation) else result.episodes


def _own_guidances(policy: ResolvedPolicy, config: CompareConfig) -> tuple[str, ...]:
    """What a policy that is not trained here is driven with: its own guidance, and others that are asked for where it
    names several: a planner that also drives without the map.
    """
    able = getattr(policy.policy, "guidances", ())
    asked = (guidance for guidance in config.guidance_names if guidance in able)
    return tuple(dict.fromkeys((policy.guidance, *asked)))


def _routes(evaluations: Sequence[api.Evaluation]) -> "pa.Table":
    """The recorded routes, a row a position: guidance, task, x_m, y_m."""
    import pyarrow as pa

    columns: dict[str, list[Any]] = {"guidance": [], "task": [], "x_m": [], "y_m": []}
    for evaluation in evaluations:
        for task, route in enumerate(evaluation.rollout.routes):
            columns["guidance"] += [evaluation.summary["guidance"]] * len(route)
            columns["task"] += [task] * len(route)
            columns["x_m"] += route[:, 0].tolist()
            columns["y_m"] += route[:, 1].tolist()
    kinds = {"guidance": pa.string(), "task": pa.int32(), "x_m": pa.float32(), "y_m": pa.float32()}
    return pa.table({name: pa.array(column, kinds[name]) for name, column in columns.items()})


def concatenated(tables: "list[pa.Table]") -> "pa.Table":
    """One table below the other."""
    import pyarrow as pa

    return pa.concat_tables(tables)


def _table(episodes: Episodes, method: str, seed: int | None, guidance: str) -> "pa.Table":
    """The episodes, with columns that say whose they are."""
    import pyarrow as pa

    table = episodes.to_table()
    whose: list[tuple[str, Any]] = [
        ("method", pa.array([method] * len(episodes), pa.string())),
        ("seed", pa.array([seed] * len(episodes), pa.int64())),
        ("guidance", pa.array([guidance] * len(episodes), pa.string())),
    ]
    for position, (name, column) in enumerate(whose):
        table = table.add_column(position, name, column)
    return table


def _train(config: RunConfig, method: str, out: Path, started_s: float) -> None:
    if method in SB3_METHODS:
        train_baseline(config, method, out, started_s)
    else:
        if not config.resume:  # what a killed worker left cannot be gone on with
            shutil.rmtree(out, ignore_errors=True)
        # A worker that was killed in its evaluation left the policy, which is evaluated anew.
        with suppress(BudgetSpent):
            train(config, start_time_s=started_s)


def train_baseline(
    config: RunConfig,
    method: str,
    out: Path,
    started_s: float | None = None,
    tuned: Mapping[str, Any] | None = None,
) -> None:
    """Stable-Baselines3 in the environment of td3. It has no checkpoints: a run that was killed starts afresh.

    config: a run of td3. method: of SB3_METHODS. started_s, tuned: see train_sb3.
    """
    from adrl.baselines.sb3 import train_sb3

    shutil.rmtree(out, ignore_errors=True)
    run = Run.of(replace(config, out=out))
    env = run.make_env(
        config.num_envs,
        randomize=config.randomize,
        task_priority=config.task_priority,
    )
    baseline = SB3_METHODS[method]
    train_sb3(
        baseline.algorithm,
        env,
        run.learner,
        out,
        policy_config=replace(run.about_policy(), method=method),
        evaluate=run.validation(),
        start_time_s=started_s,
        tuned=tuned,
        habits=baseline.habits,
    )
