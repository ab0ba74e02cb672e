"""What is compared: a training run's options, with many methods and seeds in place of one."""

import json
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import tyro

from adrl.agents.config import TrainConfig
from adrl.agents.methods import METHODS
from adrl.baselines import SB3_METHODS
from adrl.baselines.planners import PLANNER, PLANNERS
from adrl.baselines.tuned import TUNED
from adrl.comparison.given import fingerprints
from adrl.deploy.policies import find_policy
from adrl.errors import ConfigError, UnknownName
from adrl.evaluation.evaluate import EPISODES
from adrl.evaluation.family import ROBOTS, TASKS
from adrl.imitation.experts import PERFECT, find_expert
from adrl.imitation.teachers import Teacher
from adrl.registry import listed_option, look_up
from adrl.runs import RunConfig
from adrl.simulators import NATIVE
from adrl.types import GUIDANCE, RobotConfig
from adrl.worlds import RobotFamily, load_robots

ALL = "all"
EVAL_INTERVAL_STEPS = 16_000
DRIVING = 4
"""Number of what drives, and of what it is shown: results with another one are not gone on with. It grows when
planners, who demonstrates, what S is measured against, or what a guidance shows change without an option of theirs.

1: A*+DWA takes a rectangle for two discs, and demonstrates to every robot; replan shows the next waypoint, near or
   far; S of a method that does not imitate is measured against the perfect expert.
2: A*+DWA has the exact footprint, and the planner that suits the robot demonstrates; replan shows waypoints lookahead_m
   away; S of all methods of a comparison is measured against its one expert.
3: time limits of robots that turn within more than a metre are longer, robots of families turn within twice the metres
   they stop in, and labels of rounds know no recovery.
4: who is shut off on a map of its own goes through what is not surely a wall.
"""
NOT_SHARED = (
    "methods",
    "policies",
    "seeds",
    "routes",
    "keep_checkpoints",
    "workers",
    "ray",
    "out",
    "method",
    "resume",
    "shares_compiled",
)
"""Options that results in one folder may differ in."""


@dataclass(frozen=True, kw_only=True)
class CompareConfig(RunConfig):
    """A comparison. The options of a run hold for every method; give --steps or --max-seconds, the budget of each."""

    methods: str = ALL
    """Names with commas between; all: every method of ADRL. adrl list names them and the baselines."""
    policies: str = ""
    """Policies that are not trained here, a row each, with commas between: in any form that adrl evaluate --policy
    takes."""
    seeds: int = 10
    """Training seeds of each method, counted from --seed; 10 or more for a claim."""
    episodes: int | None = None
    """Tasks on which each final policy is evaluated, one episode each: 500, or 20 of each robot of a family."""
    robots: int | None = None
    """Robots of a family that each final policy drives, the first of the split: 100 when left out."""
    split: Literal["validation", "test"] = "test"
    """Which tasks: task i of a split is the same for ever."""
    eval_guidance: str | None = None
    """Guidance of the evaluation, names with commas between; as trained when left out."""
    routes: int = 0
    """Tasks, from the first, whose routes are kept: routes.parquet of each job."""
    keep_checkpoints: bool = True
    """Keep each run's checkpoint, some 100 MB, when its result is there."""
    workers: int = 0
    """Processes, each on a core of its own; 0 takes one for every usable core."""
    ray: str | None = None
    """Address of a Ray cluster, HOST:PORT, that runs the jobs instead of processes here, one for each of its CPUs."""
    out: Path = Path("runs/compare")
    """Folder of the results. The same command again goes on where it was stopped; methods and seeds may be added."""
    method: tyro.conf.Suppress[str] = "adrl"
    """Set for each job."""
    resume: tyro.conf.Suppress[bool] = False
    """Set for each job."""
    shares_compiled: tyro.conf.Suppress[bool] = False
    """Whether the jobs of this machine share compiled programs, so that seconds of training depend on which job was the
    first: for a budget in steps, where nobody asks for them. On Ray each has its own."""
    learner: Annotated[TrainConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: TrainConfig(eval_interval_steps=EVAL_INTERVAL_STEPS)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.method_names:
            look_up("method", name, {**METHODS, **SB3_METHODS, ALL: None})
        others = SB3_METHODS.keys() & set(self.method_names)
        if self.env != NATIVE and others:
            raise ConfigError(f"{min(others)} trains in our simulator only; leave it out, or env {self.env}")
        if others and isinstance(self.driven, RobotFamily):
            raise ConfigError(
                f"{min(others)} has one discount for all steps, and those of {self.driven.name} differ from robot to "
                "robot; leave it out, or give one robot"
            )
        # The training's too: a worker would be the first to see it where the evaluation has its own.
        for name in (*self.guidances, *self.guidance_names):
            if name not in GUIDANCE:
                raise UnknownName("guidance", name, GUIDANCE)
        for name, least in (("seeds", 1), ("episodes", 1), ("robots", 1), ("routes", 0), ("workers", 0)):
            if (given := getattr(self, name)) is not None and given < least:
                raise ConfigError(f"{name} is {given}; give {least} or more")
        for name in ("robots", "routes"):
            if getattr(self, name) and (name == "robots") != isinstance(self.driven, RobotFamily):
                kind = "draws robots of a family" if name == "robots" else "keeps those of one robot"
                raise ConfigError(f"{name} {kind}, and robot is {self.driven.name}; leave {name} out")

    @property
    def method_names(self) -> tuple[str, ...]:
        """The methods, each once, in the order given."""
        given = listed_option("methods", self.methods)
        return tuple(dict.fromkeys(n for name in given for n in (METHODS if name == ALL else (name,))))

    @property
    def policy_names(self) -> tuple[str, ...]:
        """The policies that are evaluated only, each once, as they were given: the planner first."""
        others = listed_option("policies", self.policies) if self.policies else ()
        return tuple(dict.fromkeys([PLANNER, *others]))

    @cached_property
    def driven(self) -> RobotConfig | RobotFamily:
        """What is trained for and evaluated with. Raises AdrlError."""
        return load_robots(self.robot)

    @property
    def shared_tasks(self) -> dict[str, int]:
        """What every evaluation drives, as options of adrl.evaluate, or of evaluate_family."""
        if isinstance(self.driven, RobotFamily):
            return {"robots": self.robots or ROBOTS, "episodes": self.episodes or TASKS}
        return {"episodes": self.episodes or EPISODES}

    @property
    def guidance_names(self) -> tuple[str, ...]:
        """Guidance of the evaluations, each once."""
        return listed_option("eval_guidance", self.eval_guidance) if self.eval_guidance else self.guidances

    def run(self, method: str, seed: int, out: Path) -> RunConfig:
        """The run of one method and seed. A baseline's is that of td3: the same environment and reward."""
        values = {f.name: getattr(self, f.name) for f in fields(RunConfig)}
        known = "td3" if method in SB3_METHODS else method
        values |= {"method": known, "out": out, "learner": replace(self.learner, seed=seed)}
        values["resume"] = self.env == NATIVE  # other simulators keep no state
        alone = RunConfig(
            **values | {"dataset": None, "expert": PERFECT, "teachers": "", "demonstration_rounds": 0}
        )
        learner = alone.resolved()
        if not learner.schedule.imitates:  # nobody is cloned
            values["demonstration_rounds"] = 0
        return RunConfig(**values) if learner.uses_expert else alone

    def title(self) -> str:
        """What all results share, in a line."""
        learner = self.learner
        budgets = [] if learner.steps is None else [f"{learner.steps} steps"]
        budgets += [] if learner.max_seconds is None else [f"{learner.max_seconds:g} s"]
        place = "" if self.env == NATIVE else f"in {self.env} "
        tasks = self.shared_tasks
        each = f" of each of {tasks['robots']} robots" if "robots" in tasks else ""
        return (
            f"scenario {self.load().name}, robot {self.driven.name}, trained {place}with guidance "
            f"{self.resolved_guidance()} for {' or '.join(budgets)}, {tasks['episodes']} {self.split} tasks{each}"
        )

    def document(self) -> dict[str, Any]:
        """All of it as JSON has it; from_document is the inverse."""
        return json.loads(json.dumps(asdict(self), default=str, allow_nan=False))

    def settings(self) -> dict[str, Any]:
        """What all results in one folder must share: neither methods nor seeds, nor where they are made."""
        content = self.document()
        content["expert"] = str(find_expert(self.expert))
        if self.teachers:  # by their weights: a run's may change
            named = listed_option("teachers", self.teachers)
            content["teachers"] = [Teacher.of(one).policy.fingerprint for one in named]
        for name in NOT_SHARED:
            del content[name]
        del content["learner"]["seed"]
        # Names become what they stand for today: a robot's file may change.
        content["scenario"] = self.load().name
        content["robot"] = json.loads(json.dumps(asdict(self.driven)))
        content |= self.shared_tasks
        content["guidance"] = self.resolved_guidance()
        content["eval_guidance"] = ",".join(self.guidance_names)
        if self.given:
            content["given"] = dict(self.given)
        return content

    @cached_property
    def given(self) -> dict[str, str]:
        """Fingerprints of what stands in the files that are given; read once, datasets are large. Raises AdrlError."""
        return fingerprints(self)

    def method_settings(self) -> dict[str, Any]:
        """What each method makes of the learner today, as JSON has it: name -> configuration, without the seed.

        A method's few lines may change from one version to the next while the options stay.
        """
        content = {}
        for name in self.method_names:
            learner = asdict(self.run(name, self.learner.seed, self.out).resolved())
            del learner["seed"]
            if name in SB3_METHODS:
                learner["tuned"] = TUNED[SB3_METHODS[name].algorithm]
            content[name] = json.loads(json.dumps(learner, default=str, allow_nan=False))
        called = {name: name for name in self.method_names}
        for text in self.policy_names:
            policy = find_policy(text, PLANNERS)
            if policy.name in called:
                raise ConfigError(
                    f"{called[policy.name]} and {text} are both called {policy.name}; give one of them another name"
                )
            called[policy.name] = text
            if policy.fingerprint is not None:
                content[text] = {"policy_fingerprint": policy.fingerprint}
        return content


def from_document(content: dict[str, Any]) -> CompareConfig:
    """The comparison that document() describes."""
    return _restored(CompareConfig, content)


def _restored(kind: Any, value: Any) -> Any:
    """A value of this type, from what JSON made of it."""
    for option in get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,):
        hints = get_type_hints(option) if is_dataclass(option) else {}
        if isinstance(value, dict) and hints and value.keys() <= hints.keys():
            return option(**{name: _restored(hints[name], entry) for name, entry in value.items()})  # pyright: ignore
        if get_origin(option) is tuple and isinstance(value, list):
            return tuple(_restored(get_args(option)[0], entry) for entry in value)
        if option is Path and isinstance(value, str):
            return Path(value)
    return value


def differences(first: dict[str, Any], second: dict[str, Any]) -> list[str]:
    """Lines "learner.steps: 1000 there, 2000 here" for every setting that differs."""
    lines = []
    for key in dict.fromkeys([*first, *second]):
        there, here = first.get(key), second.get(key)
        if isinstance(there, dict) and isinstance(here, dict):
            lines += [f"{key}.{line}" for line in differences(there, here)]
        elif there != here:
            lines.append(f"{key}: {json.dumps(there)} there, {json.dumps(here)} here")
    return lines
