"""A training run from nothing: worlds, demonstrations, probe, learner, validation, and its folder."""

import functools
import json
import platform
import re
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import tyro

from adrl import files
from adrl.agents import budget, checkpoint
from adrl.agents.config import TrainConfig
from adrl.agents.interface import Progress, Validation
from adrl.agents.methods import Method, method_config, method_name
from adrl.deploy.policy import MlpPolicy, PolicyConfig, load_policy, resolve_policy
from adrl.deploy.setup import training_worlds
from adrl.envs import Body, NavVectorEnv
from adrl.errors import ConfigError
from adrl.evaluation.metrics import success_rate
from adrl.evaluation.rollout import Rewards, rollout
from adrl.imitation import Demonstrations, Source, collect, load_minari, recorded_worlds
from adrl.imitation.probe import probe_steps, record_probe
from adrl.observation import EncoderConfig
from adrl.outputs import locked, require_folder
from adrl.planning.replanner_config import ReplannerConfig
from adrl.rewards.config import STANDING_AT_WORST
from adrl.rewards.step import reference_period_s
from adrl.signals import stop_requests
from adrl.types import RobotConfig, Scenario
from adrl.worlds import load_robot, task_set
from adrl.worlds.given import training_fingerprints
from adrl.worlds.place import Place

if TYPE_CHECKING:
    from adrl.agents.interface import TrainResult

PROBE_STATES = 32
"""Each is driven from twice: at random, and by the expert."""
RUN_FILES = ("versions.json", "metrics.jsonl", "policy.safetensors", checkpoint.FOLDER)
"""One of these stands in the folder of a run."""
VERSIONED = ("adrl", "numpy", "jax", "jaxlib", "gymnasium", "safetensors")


@dataclass(frozen=True, kw_only=True)
class RunConfig(Place):
    """A training run. Give steps or max_seconds in the learner's configuration."""

    robot: Annotated[str | RobotConfig, tyro.conf.arg(constructor=str)] = "diffbot"
    """A robot's name (adrl list), a TOML file, or the object."""
    method: Annotated[str | Method, tyro.conf.arg(constructor=str)] = "adrl"
    """A training method's name (adrl list), or the function."""
    paper_literal: bool = False
    """Compute every equation as the paper prints it, whatever the method."""
    guidance: str | None = None
    """goal: the policy sees the final goal; replan: that, and waypoints of its own map when blocked (eqs 18-23);
    map: a waypoint on the A* path of the known map. Left out: map with --map or --world, else goal."""
    replanner: ReplannerConfig = field(default_factory=ReplannerConfig)
    env: Literal["native", "gazebo"] = "native"
    """What moves and senses the robots of training: our simulator, or Gazebo (scripts/gazebo-chroot sets it up), which
    does not randomise. Probe and validation are in our simulator either way."""
    fine_tune: Path | None = None
    """Run folder of a policy to begin with, or default: fine-tuning. It is held until the critics are warm, see
    critic_warmup_updates."""
    out: Path | None = None
    """Run folder; runs/METHOD-SCENARIO-ROBOT-GUIDANCE-sSEED when left out."""
    resume: bool = False
    """Go on from the newest checkpoint in the run folder; give the same options again."""
    num_envs: int = 64
    """Robots simulated side by side."""
    task_pool: int = 512
    """Worlds to train in, the first ones of the training split."""
    task_priority: ClassVar[float] = 1.0
    """Draw tasks that failed lately more often: chances are 0.1 + task_priority * failure rate; 0 for all alike."""
    demonstration_steps: int = 10_000
    """Environment steps of A*+DWA demonstrations to collect."""
    dataset: Path | None = None
    """Minari dataset of demonstrations to use instead of collecting them."""
    validation_episodes: int = 100
    """Validation tasks of each evaluation during training, every learner.eval_interval_steps."""
    randomize: bool = True
    """Vary robots and sensors mildly from episode to episode."""
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    learner: Annotated[TrainConfig, tyro.conf.arg(name="")] = field(default_factory=TrainConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.env == "gazebo" and self.resume:
            raise ConfigError("a run in Gazebo cannot be resumed: Gazebo keeps no state; start another")
        for name in ("num_envs", "task_pool", "validation_episodes"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} is {getattr(self, name)}; give 1 or more")
        learner = self.resolved()
        _check_horizon(learner)
        if self.dataset is not None and not learner.schedule.imitates:
            raise ConfigError(
                f"method {method_name(self.method)!r} learns without demonstrations; leave out dataset"
            )
        if self.demonstration_steps < 0:
            raise ConfigError(f"demonstration_steps is {self.demonstration_steps}; give 0 or more")

    def resolved(self) -> TrainConfig:
        """The learner's configuration as the method has it, under the run's guidance."""
        learner = method_config(self.method, self.learner)
        learner = replace(learner, schedule=learner.schedule.under(self.resolved_guidance()))
        return learner.literal() if self.paper_literal else learner

    def resolved_guidance(self) -> str:
        """The guidance that was given, or the place's own."""
        return self.guidance or self.default_guidance

    def resolved_replanner(self) -> ReplannerConfig:
        """The replanner's constants, as printed where all is."""
        return self.replanner.literal() if self.paper_literal else self.replanner


def _check_horizon(learner: TrainConfig) -> None:
    """A crash must stay worse than standing for ever, or the policy learns to crash (corrected forms)."""
    gamma, reward = learner.td3.gamma, learner.reward
    standing = STANDING_AT_WORST / max(1.0 - gamma, 1e-9)
    if standing >= reward.failure_weight * reward.failure_penalty:
        raise ConfigError(
            f"td3.gamma is {gamma}: standing in the worst place for ever costs {standing:.0f}, no less than "
            f"a crash; give a smaller gamma, or reward.failure_weight above {standing / reward.failure_penalty:.2f}"
        )


def train(
    config: RunConfig,
    *,
    on_progress: Callable[[Progress], None] | None = None,
    start_time_s: float | None = None,
) -> "TrainResult":
    """Train a policy and leave it in the run folder.

    start_time_s: of time.monotonic(); max_seconds counts from there. Raises AdrlError; what a run folder already
    holds is not touched unless resume is asked for.
    """
    start_time_s = time.monotonic() if start_time_s is None else start_time_s
    budget.require_end(config.learner)
    scenario, robot = config.load(), load_robot(config.robot)
    learner = with_horizon_of(config.resolved(), robot)
    out = run_folder(config, scenario)
    require_folder("out", out, *RUN_FILES)
    if (out / "policy.safetensors").exists() and not config.resume:
        raise ConfigError(
            f"{out} holds a finished run; give another --out, or --resume to train it for longer"
        )
    resumed = checkpoint.exists(out)
    if resumed and not config.resume:
        raise ConfigError(f"{out} holds an unfinished run; give --resume to go on with it, or another --out")
    if resumed and config.guidance is None:
        config = replace(config, guidance=checkpoint.settings(out).get("guidance"))
        learner = with_horizon_of(config.resolved(), robot)
    start = None if config.fine_tune is None else load_policy(resolve_policy(config.fine_tune))
    make_env = env_maker(config, learner, scenario, robot)
    tell = _teller(config, on_progress, start_time_s)
    with locked(out), _robots(config, robot) as body:
        tell("worlds")
        env = make_env(
            config.num_envs,
            randomize=config.randomize and body is None,
            task_priority=config.task_priority,
            body=body,
        )
        return _train(config, learner, env, make_env, out, start, resumed, tell, on_progress, start_time_s)


def _teller(
    config: RunConfig, on_progress: Callable[[Progress], None] | None, start_time_s: float
) -> Callable[[str], None]:
    """Tells a phase of the set-up to the progress hook."""

    def tell(phase: str) -> None:
        if on_progress is not None:
            wall_s = time.monotonic() - start_time_s
            fraction = budget.spent_fraction(config.learner, 0, wall_s)
            on_progress(Progress(phase=phase, fraction=fraction, wall_s=wall_s))

    return tell


def _robots(config: RunConfig, robot: RobotConfig) -> AbstractContextManager[Body | None]:
    """What moves the robots of training; None for our simulator."""
    if config.env == "native":
        return nullcontext()
    from adrl.integrations.gazebo import Gazebo

    return Gazebo(robot, config.num_envs, seed=config.learner.seed)


def _train(
    config: RunConfig,
    learner: TrainConfig,
    env: NavVectorEnv,
    make_env: Callable[..., NavVectorEnv],
    out: Path,
    start: MlpPolicy | None,
    resumed: bool,
    tell: Callable[[str], None],
    on_progress: Callable[[Progress], None] | None,
    start_time_s: float,
) -> "TrainResult":
    """The run in its environment."""
    scenario, robot = env.scenario, env.robot
    began_s = time.monotonic()
    tell("demonstrations")
    demonstrations = _demonstrations(config, env) if learner.schedule.imitates else None
    demonstrated_s = time.monotonic()
    probed = learner.measures_maturity and learner.schedule.needs_probe
    probe = None
    if probed:
        tell("probe")
        # Few tasks: a random policy's crashes would call for ever new ones, each to be made.
        probe_env = make_env(2 * PROBE_STATES, randomize=False, task_pool=min(config.task_pool, PROBE_STATES))
        probe = record_probe(probe_env, learner.seed, probe_steps(learner.td3.gamma))
    setup = {
        "demonstration_seconds": demonstrated_s - began_s,
        "probe_seconds": time.monotonic() - demonstrated_s,
    }
    if not resumed:
        files.write_json(out / "versions.json", versions())

    from adrl.agents.train import train as learn

    # Gazebo's own processes end with the same signals, and keep no state to go on from.
    requests = stop_requests() if config.env == "native" else nullcontext(lambda: False)
    with requests as stopped:
        return learn(
            learner,
            env,
            out,
            policy_config=about_policy(config, robot, scenario, out, setup),
            demonstrations=demonstrations,
            probe=probe,
            mirror=env.sim.encoder.mirror,
            start=start,
            evaluate=validation(config, scenario, robot, learner),
            on_progress=on_progress,
            start_time_s=start_time_s,
            resume=config.resume,
            stopped=stopped,
        )


def env_maker(
    config: RunConfig, learner: TrainConfig, scenario: Scenario, robot: RobotConfig
) -> Callable[..., NavVectorEnv]:
    """NavVectorEnv with the run's place, robot, guidance and encoder filled in, the learner's reward and first S."""
    return functools.partial(
        NavVectorEnv,
        scenario=scenario,
        robot=robot,
        guidance=config.resolved_guidance(),
        replanner=config.resolved_replanner(),
        task_pool=config.task_pool,
        task_priority=0.0,
        encoder=config.encoder,
        reward_config=learner.reward,
        maturity=0.0 if learner.measures_maturity else learner.static_maturity,
    )


def with_horizon_of(learner: TrainConfig, robot: RobotConfig) -> TrainConfig:
    """The learner with gamma for the robot: control periods differ, and slow robots look ahead for longer."""
    gamma = learner.td3.gamma ** (robot.control_period_s / reference_period_s(robot.max_speed_mps))
    return replace(learner, td3=replace(learner.td3, gamma=gamma))


def run_folder(config: RunConfig, scenario: Scenario) -> Path:
    """Where the run goes: by default a name that tells what it is."""
    if config.out is not None:
        return config.out
    parts = (
        method_name(config.method),
        scenario.name,
        load_robot(config.robot).name,
        config.resolved_guidance(),
    )
    name = "-".join(re.sub(r"[^\w.-]+", "-", part) for part in parts)
    return Path("runs") / f"{name}-s{config.learner.seed}"


def versions() -> dict[str, str]:
    """What the run was made with."""
    return {"python": platform.python_version(), "machine": platform.machine()} | {
        name: metadata.version(name) for name in VERSIONED
    }


def _demonstrations(config: RunConfig, env: NavVectorEnv) -> Demonstrations:
    if config.dataset is not None:
        return load_minari(config.dataset, Source.of(env))
    if config.demonstration_steps == 0:
        raise ConfigError(
            f"method {method_name(config.method)!r} needs demonstrations; demonstration_steps is 0"
        )
    return collect(env, config.demonstration_steps, seed=config.learner.seed)


def about_policy(
    config: RunConfig,
    robot: RobotConfig,
    scenario: Scenario,
    out: Path,
    setup_seconds: Mapping[str, float] | None = None,
) -> PolicyConfig:
    """What is saved with the policy; the learner fills in the sizes and what training took.

    setup_seconds: wall clock of what came before the first update, told apart.
    """
    guidance = config.resolved_guidance()
    run = asdict(replace(config, robot=robot.name, guidance=guidance)) | {
        "method": method_name(config.method)
    }
    learner, replanner = config.resolved(), config.resolved_replanner()
    replans_as_printed = guidance != "replan" or replanner == replanner.literal()
    return PolicyConfig(
        input_size=1,  # set by the learner, as is the next
        widths=config.learner.td3.widths,
        robot=asdict(robot),
        encoder=config.encoder.fields(),
        guidance=guidance,
        method=method_name(config.method),
        extra={
            "environment": {
                "scenario": scenario.name,
                "num_envs": config.num_envs,
                "task_pool": config.task_pool,
                "task_priority": config.task_priority,
                "randomize": config.randomize and config.env == "native",
                **({"simulator": config.env} if config.env != "native" else {}),
                **({"fine_tune": str(config.fine_tune)} if config.fine_tune is not None else {}),
                **_worlds(config, scenario),
                "replanner": asdict(replanner),
            },
            "run": out.name,
            # Of the weights that a replay shows; maturity None: the policy's own.
            "reward": {
                "constants": asdict(learner.reward)
                | {"extra_terms": list(map(str, learner.reward.extra_terms))},
                "maturity": None if learner.dynamic_reward else learner.static_maturity,
            },
            **(setup_seconds or {}),
            "scenario": scenario.name,
            "paper_literal": learner == learner.literal() and replans_as_printed,
            "settings": json.loads(json.dumps(run, default=str)),
        },
    )


def _worlds(config: RunConfig, scenario: Scenario) -> dict[str, list[str] | None]:
    """The entry that says which given worlds the policy has learned from, by fingerprint: None where a part of what it
    learns from does not say. No entry for a run that has drawn ones alone.
    """
    sources: list[set[str] | None] = [training_fingerprints(scenario)]
    if config.fine_tune is not None:
        sources.append(training_worlds(load_policy(resolve_policy(config.fine_tune)).config))
    if config.dataset is not None:
        sources.append(recorded_worlds(config.dataset))
    if sources == [set()]:
        return {}
    known = [worlds for worlds in sources if worlds is not None]
    return {"worlds": sorted(set().union(*known)) if len(known) == len(sources) else None}


def validation(
    config: RunConfig, scenario: Scenario, robot: RobotConfig, learner: TrainConfig
) -> Callable[[MlpPolicy, float], Validation]:
    """Drives the first validation tasks, drawn when first asked for."""

    @functools.cache
    def tasks() -> Any:
        return task_set(scenario, robot, "validation", config.validation_episodes)

    def evaluate(policy: MlpPolicy, maturity: float) -> Validation:
        result = rollout(
            policy,
            tasks(),
            robot,
            guidance=config.resolved_guidance(),
            encoder=config.encoder,
            num_threads=1,
            replanner=config.resolved_replanner(),
            maturity=policy.config.maturity,
            rewards=Rewards(config=learner.reward, gamma=learner.td3.gamma, maturity=maturity),
        )
        return Validation(
            success=success_rate(result.episodes),
            start=result.start,
            discounted_return=float(result.discounted_return.mean()),
        )

    return evaluate
