"""What a training run is asked for: names and files, as the command line gives them."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from adrl.agents.config import TrainConfig
from adrl.agents.methods import Method, method_config, method_name
from adrl.errors import ConfigError
from adrl.imitation.experts import PERFECT, Expert, find_expert
from adrl.observation import EncoderConfig
from adrl.outputs import as_paths
from adrl.planning.replanner_config import ReplannerConfig
from adrl.ranges import Range
from adrl.registry import listed_option
from adrl.rewards.config import STANDING_AT_WORST
from adrl.simulators import NATIVE, find_simulator
from adrl.types import RobotConfig
from adrl.worlds.families import RobotFamily
from adrl.worlds.place import Place, split_guidance
from adrl.worlds.robots import load_robots


@dataclass(frozen=True, kw_only=True)
class RunConfig(Place):
    """A training run. Give steps or max_seconds in the learner's configuration."""

    robot: Annotated[str | RobotConfig | RobotFamily, tyro.conf.arg(constructor=str)] = "diffbot"
    """A robot's name (adrl list), a TOML file, or the object. A family, as any, gives each task a robot of its own, and
    the policy is told of its body: see encoder."""
    method: Annotated[str | Method | None, tyro.conf.arg(constructor=str)] = None
    """A training method's name (adrl list), or the function. Left out: adrl, and td3 with fine_tune, whose time no
    expert takes."""
    paper_literal: bool = False
    """Compute every equation as the paper prints it, whatever the method."""
    guidance: str | None = None
    """goal: the policy sees the final goal; replan: that, and waypoints of its own map when blocked (eqs 18-23);
    map: a waypoint on the A* path of the known map. Left out: map with --map or --world, else goal. Several, with
    commas between, are all learned; the first is the policy's where none is asked for. goal@clutter is one that is
    learned in clutter alone, where robots are of a family."""
    replanner: ReplannerConfig = field(default_factory=ReplannerConfig)
    env: str = NATIVE
    """What moves and senses the robots of training: a simulator's name (adrl list). Ours is native; the others do not
    randomise, and Gazebo is set up by scripts/gazebo-chroot. Probe and validation are in ours either way."""
    fine_tune: Path | None = None
    """Run folder of a policy to begin with, or a shipped one: fine-tuning. What is left is the best of all that were
    validated, the first among them. It is held until the critics are warm: critic_warmup_updates, 500 for 0."""
    out: Path | None = None
    """Run folder; runs/METHOD-SCENARIO-ROBOT-GUIDANCE-sSEED when left out."""
    resume: bool = False
    """Go on from the newest checkpoint in the run folder; give the same options again."""
    num_envs: Annotated[int, Range(1, 65536)] = 64
    """Robots simulated side by side; 1 to 65536."""
    task_pool: Annotated[int, Range(1, 1_000_000)] = 512
    """Worlds to train in, the first ones of the training split; 1 to 1e+06."""
    task_priority: ClassVar[float] = 1.0
    """Draw tasks that failed lately more often: chances are 0.1 + task_priority * failure rate; 0 for all alike."""
    expert: Annotated[str | Expert, tyro.conf.arg(constructor=str)] = PERFECT
    """Who demonstrates: NAME or NAME:NUMBER, as slow:0.5 (adrl list), or the object."""
    demonstration_steps: Annotated[int, Range(0, 100_000_000)] | None = None
    """Environment steps of demonstrations to collect, 0 to 1e+08; of the expert few its drives, whatever they take.
    Left out: 10000, and 3000 with fine_tune."""
    demonstration_rounds: Annotated[int, Range(0, 1000)] = 0
    """In so many rounds after the first a clone of all that was shown so far drives, and the expert says what it would
    do where that comes to: DAgger (Ross et al. 2011). demonstration_steps are shared out evenly, and training begins
    with the last clone, as fine_tune does with its policy: held at first, and the best is kept; 0 to 1000."""
    teachers: str = ""
    """Policies, run folders with commas between, that answer in the expert's place in tasks of the scenario and
    guidance that they were trained in. Train them with the same robot, encoder and stop_within_m."""
    dataset: Path | None = None
    """Minari dataset of demonstrations to use instead of collecting them."""
    validation_episodes: Annotated[int, Range(1, 1_000_000)] = 100
    """Validation tasks of each evaluation during training, every learner.eval_interval_steps; 1 to 1e+06."""
    randomize: bool = True
    """Vary robots and sensors mildly from episode to episode."""
    stop_within_m: Annotated[float, Range(0.01, 1000.0)] | None = None
    """The policy asks for no more speed than the robot stops from within so many metres, and turns at within twice as
    many: what is learnt of one robot is then of use to another; 0.01 to 1000 m. Left out: 0.3 m for a family, 1000 for
    a robot."""
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    learner: Annotated[TrainConfig, tyro.conf.arg(name="")] = field(default_factory=TrainConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        as_paths(self, "out", "fine_tune", "dataset")
        find_simulator(self.env)
        if self.env != NATIVE and self.resume:
            raise ConfigError(f"a run in {self.env} cannot be resumed: it keeps no state; start another")
        learner = self.resolved()
        _check_horizon(learner)
        chosen = find_expert(self.expert) != find_expert(PERFECT)
        taught = self.teachers != ""
        for name, given in (("dataset", self.dataset is not None), ("expert", chosen), ("teachers", taught)):
            if given and not learner.uses_expert:
                raise ConfigError(
                    f"method {method_name(self.chosen_method)!r} learns without an expert; leave out {name}"
                )
        unasked = {
            "dataset": self.dataset is not None,
            "fine_tune": self.fine_tune is not None,
            f"method {method_name(self.chosen_method)}": not learner.schedule.imitates,
            f"expert {self.expert}": getattr(find_expert(self.expert), "drives", None) is not None,
        }
        for other in (name for name, given in unasked.items() if given and self.demonstration_rounds > 0):
            raise ConfigError(
                f"demonstration_rounds asks an expert what it would do where a clone drives, and {other} leaves nobody "
                "to ask; leave one out"
            )
        for name, given in (("expert", chosen), ("teachers", taught)):
            if given and self.dataset is not None:
                raise ConfigError(
                    f"{name} {getattr(self, name)} would drive, and dataset holds what was driven; leave one out"
                )

    @property
    def chosen_method(self) -> str | Method:
        """The method that was given, or the one for want of it."""
        return self.method or ("adrl" if self.fine_tune is None else "td3")

    def resolved(self) -> TrainConfig:
        """The learner's configuration as the method has it, under the run's guidance."""
        learner = method_config(self.chosen_method, self.learner)
        mapless = [name for name in self.guidances if name != "map"]
        learner = replace(learner, schedule=learner.schedule.under(mapless[0] if mapless else "map"))
        return learner.literal() if self.paper_literal else learner

    def resolved_guidance(self) -> str:
        """The guidance that was given, or the place's own."""
        return self.guidance or self.default_guidance

    @property
    def one_robot(self) -> RobotConfig:
        """The robot, where it is one. Raises AdrlError."""
        robot = load_robots(self.robot)
        if isinstance(robot, RobotFamily):
            raise ConfigError(f"robot {robot.name} is a family of robots; give one robot")
        return robot

    @property
    def guidances(self) -> tuple[str, ...]:
        """All that are learned."""
        return tuple(dict.fromkeys(split_guidance(text)[0] for text in self.placed_guidances))

    @property
    def placed_guidances(self) -> tuple[str, ...]:
        """The same, each with the place that it is learned in alone; see Mixture."""
        return listed_option("guidance", self.resolved_guidance())

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
