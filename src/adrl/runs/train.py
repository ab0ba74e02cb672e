"""A training run from nothing: worlds, demonstrations, probe, learner, validation, and its folder."""

import logging
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path

from adrl import extras, files
from adrl.agents import budget, checkpoint
from adrl.agents.interface import Progress, TrainResult
from adrl.agents.methods import method_name
from adrl.agents.metrics import METRICS_FILE, TENSORBOARD_FOLDER
from adrl.deploy.policy import WEIGHTS_FILE, MlpPolicy
from adrl.envs import Body, NavVectorEnv
from adrl.errors import AdrlError, ConfigError
from adrl.imitation import Demonstrations, Source, collect, load_minari
from adrl.imitation.best_planner import planner_of
from adrl.imitation.probe import Probe, as_shown, probe_steps, record_probe
from adrl.imitation.teachers import Taught
from adrl.outputs import locked, require_folder
from adrl.runs import rounds
from adrl.runs.config import RunConfig
from adrl.runs.record import versions
from adrl.runs.run import Run
from adrl.signals import stop_requests
from adrl.types import RobotConfig
from adrl.worlds import RobotFamily

LOG = logging.getLogger("adrl.runs")
PROBE_STATES = 32
"""Each is driven from twice: at random, and by the expert."""
VERSIONS_FILE = "versions.json"
RUN_FILES = (VERSIONS_FILE, METRICS_FILE, WEIGHTS_FILE, checkpoint.FOLDER)
"""One of these stands in the folder of a run."""
Hook = Callable[[Progress], None]


def train(
    config: RunConfig,
    *,
    on_progress: Hook | None = None,
    start_time_s: float | None = None,
) -> TrainResult:
    """Train a policy and leave it in the run folder.

    start_time_s: of time.monotonic(); max_seconds counts from there. Raises AdrlError; what a run folder already
    holds is not touched unless resume is asked for, and one that comes to neither a policy nor a checkpoint leaves
    nothing.
    """
    extras.require("train", "training")
    start_time_s = time.monotonic() if start_time_s is None else start_time_s
    budget.require_end(config.learner)
    run = Run.of(_as_begun(config))
    require_folder("out", run.folder, *RUN_FILES)
    resumed = checkpoint.exists(run.folder)
    if not config.resume:
        _require_no_run(run, resumed or rounds.exist(run.folder))
    elif (run.folder / WEIGHTS_FILE).exists() and not (resumed or rounds.exist(run.folder)):
        raise ConfigError(
            f"{run.folder} holds a finished run whose checkpoint is gone: it cannot be trained for longer. "
            "Give another --out, and --fine-tune with this folder to begin with its policy"
        )
    elif rounds.exist(run.folder) and config.demonstration_rounds == 0:
        raise ConfigError(f"{run.folder} holds a run with demonstration_rounds; give as many again")
    alone = run.robot if isinstance(run.robot, RobotConfig) else None
    strange = None if run.start is None or alone is None else run.start.strange(alone)
    if strange is not None:
        LOG.warning(strange)
    tell = _teller(config, on_progress, start_time_s)
    with locked(run.folder), _nothing_by_halves(run.folder), _robots(run) as body:
        tell("worlds")
        env = run.make_env(
            config.num_envs,
            randomize=config.randomize and body is None,
            task_priority=config.task_priority,
            body=body,
        )
        return _train(run, env, resumed, tell, on_progress, start_time_s)


@contextmanager
def _nothing_by_halves(folder: Path) -> Iterator[None]:
    """A training that is refused leaves what it can be resumed by, or nothing that looks like a run."""
    try:
        yield
    except AdrlError:
        if not ((folder / WEIGHTS_FILE).exists() or checkpoint.exists(folder) or rounds.exist(folder)):
            for name in (VERSIONS_FILE, METRICS_FILE):
                (folder / name).unlink(missing_ok=True)
            for name in (TENSORBOARD_FOLDER, checkpoint.FOLDER):
                shutil.rmtree(folder / name, ignore_errors=True)
        raise


def _as_begun(config: RunConfig) -> RunConfig:
    """A run that is gone on with has the guidance of its newest checkpoint, if no other is given.

    A folder of its own (no out) is named after its guidance, so there is nothing to look up.
    """
    if not config.resume or config.out is None or config.guidance is not None:
        return config
    said = checkpoint.settings(config.out)
    environment = said.get("environment") or {}
    several = environment.get("placed_guidances") or environment.get("guidances")
    return replace(config, guidance=",".join(several) if several else said.get("guidance"))


def _require_no_run(run: Run, resumed: bool) -> None:
    if (run.folder / WEIGHTS_FILE).exists():
        raise ConfigError(
            f"{run.folder} holds a finished run; give another --out, or --resume to train it for longer"
        )
    if resumed:
        raise ConfigError(
            f"{run.folder} holds an unfinished run; give --resume to go on with it, or another --out"
        )


def _teller(config: RunConfig, on_progress: Hook | None, start_time_s: float) -> Callable[[str], None]:
    """Tells a phase of the set-up to the progress hook."""

    def tell(phase: str) -> None:
        if on_progress is not None:
            wall_s = time.monotonic() - start_time_s
            fraction = budget.spent_fraction(config.learner, 0, wall_s)
            on_progress(Progress(phase=phase, fraction=fraction, wall_s=wall_s))

    return tell


def _robots(run: Run) -> AbstractContextManager[Body | None]:
    """What moves the robots of training, as a context; None for our simulator."""
    if run.simulator is None or isinstance(run.robot, RobotFamily):
        return nullcontext()
    return run.simulator(run.robot, run.config.num_envs, seed=run.learner.seed)


def _train(
    run: Run,
    env: NavVectorEnv,
    resumed: bool,
    tell: Callable[[str], None],
    on_progress: Hook | None,
    start_time_s: float,
) -> TrainResult:
    """The run in its environment."""
    began_s = time.monotonic()
    tell("demonstrations")
    imitates, probed = run.learner.schedule.imitates, run.learner.needs_probe
    shown = imitates or (probed and _no_more_is_shown(run))
    demonstrates = shown and run.config.dataset is None
    drives = demonstrates or (probed and run.start is None)
    all_taught = isinstance(run.expert, Taught) and run.tasks <= run.expert.tasks
    planner = planner_of(run.expert, env) if drives and not all_taught else None
    if planner is not None:
        env.expert = planner.controller
    demonstrations, clone, spent_s = _demonstrations(run, env, tell) if shown else (None, None, 0.0)
    demonstrated_s = time.monotonic()
    began_s -= spent_s
    if not resumed:  # a checkpoint counts it
        start_time_s -= spent_s
    probe = None
    if probed:
        tell("probe")
        probe = _probe(run, env.expert, demonstrations)
    demonstrator = planner if demonstrates else None
    about = run.about_policy(
        planner=demonstrator,
        demonstration_seconds=demonstrated_s - began_s,
        probe_seconds=time.monotonic() - demonstrated_s,
    )
    if not resumed:
        files.write_json(run.folder / VERSIONS_FILE, versions(demonstrator))

    from adrl.agents.train import train as learn

    start = clone if run.start is None else run.start.policy
    # Another simulator's own processes end with the same signals, and keep no state to go on from.
    requests = stop_requests() if run.simulator is None else nullcontext(lambda: False)
    with requests as stopped:
        return learn(
            run.learner,
            env,
            run.folder,
            policy_config=about,
            demonstrations=demonstrations if imitates else None,
            probe=probe,
            mirror=env.sim.encoder.mirror,
            start=start,
            keep_best=start is not None and run.simulator is None,
            evaluate=run.validation(),
            on_progress=on_progress,
            start_time_s=start_time_s,
            resume=run.config.resume,
            stopped=stopped,
        )


def _probe(run: Run, planner: str, demonstrations: Demonstrations | None) -> Probe:
    """What chance earns, and the demonstrations: their expert's own drives from the probe's states, or theirs where
    these are all there is. Fine-tuning is measured against the policy that it begins with: no planner has to drive.
    """
    # Few tasks: a random policy's crashes would call for ever new ones, each to be made.
    task_pool = min(run.config.task_pool, PROBE_STATES)
    env = run.make_env(2 * PROBE_STATES, randomize=False, task_pool=task_pool)
    env.expert = planner
    seed, steps = run.learner.seed, probe_steps(run.learner.td3.gamma**env.sim.least_periods)
    if run.start is not None:
        start = run.start.policy
        return record_probe(env, seed, steps, lambda: start.act(env.sim.observe()))
    probe = record_probe(env, seed, steps, run.expert.driver(env, seed).actions)
    if demonstrations is not None and _no_more_is_shown(run):
        return replace(probe, expert=as_shown(demonstrations, steps))
    return probe


def _no_more_is_shown(run: Run) -> bool:
    """Whether the demonstrations are all there is of the expert: it cannot be asked to drive on."""
    return run.config.dataset is not None or getattr(run.expert, "drives", None) is not None


def _demonstrations(
    run: Run, env: NavVectorEnv, tell: Callable[[str], None]
) -> tuple[Demonstrations, MlpPolicy | None, float]:
    """What is shown, the clone of it that training begins with, if there is one, and the seconds that a run which was
    stopped had spent on it."""
    config, learner = run.config, run.learner
    if config.dataset is not None:
        return load_minari(config.dataset, Source.of(env)), None, 0.0
    if run.demonstration_steps == 0:
        raise ConfigError(
            f"method {method_name(config.chosen_method)!r} needs demonstrations; demonstration_steps is 0"
        )
    if config.demonstration_rounds > 0:
        outcome = rounds.demonstrate(run, env, tell)
        return outcome.shown, outcome.clone, outcome.seconds_before
    return collect(env, run.demonstration_steps, expert=run.expert, seed=learner.seed), None, 0.0
