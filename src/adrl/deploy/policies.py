"""The one place where what a user calls a policy becomes one: name, folder, file, module:object, or the object."""

import importlib
import math
import os
import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.deploy.another_robot import as_trained, other_robot, outside_family, require_encodable
from adrl.deploy.onnx_policy import load_onnx
from adrl.deploy.policy import SHIPPED, MlpPolicy, load_policy, resolve_policy
from adrl.deploy.sb3_policy import load_sb3
from adrl.deploy.setup import setup_of
from adrl.deploy.training_worlds import training_worlds
from adrl.errors import AdrlError, ConfigError, UnknownName
from adrl.observation import Encoder, EncoderConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.registry import look_up, offered
from adrl.types import GUIDANCE, RobotConfig
from adrl.worlds.families import RobotFamily
from adrl.worlds.robots import load_robot, load_robots

FILES: dict[str, Callable[[Path], Any]] = {".onnx": load_onnx, ".zip": load_sb3}
"""Files of other programs: ending -> what reads one."""
DEFAULT_ROBOT = "diffbot"
"""Drives where neither the user nor the policy names one."""


@dataclass(frozen=True, kw_only=True)
class ResolvedPolicy:
    """A policy, and all that running it needs to know of it."""

    policy: Any
    """Has act(observation); one that knows the world has act_in(simulator) instead."""
    name: str
    method: str = "external"
    """How it was made: adrl, td3, ..., a planner's name, or external."""
    robot: RobotConfig | None = None
    """The robot it was made for; None for any."""
    family: RobotFamily | None = None
    """The family whose robots it was made for; None where it says none."""
    trained_as: RobotConfig | None = None
    """That robot as the policy takes it; as it is when None."""
    encoder: EncoderConfig | Encoder = field(default_factory=EncoderConfig)
    plans_itself: bool = False
    """Whether it makes its own routes: with guidance `replan` no replanner makes any for it."""
    told_of_body: bool = False
    """Whether it is told what the robot's body is, and takes each as it is."""
    stop_within_m: float = math.inf
    """See RobotConfig.slowed: it asks for no greater speed; infinite for any."""
    encoder_inside: bool = False
    """Whether it encodes measurements by itself, as one of its own robot."""
    guidance: str = "goal"
    replanner: ReplannerConfig = field(default_factory=ReplannerConfig)
    """The constants of guidance `replan`."""
    maturity: float = 0.0
    """S at the end of training; the replanner's thresholds follow it."""
    fingerprint: str | None = None
    """The same for the same weights; None for code."""
    training_worlds: Collection[str] | None = None
    """Fingerprints of the given worlds that it has learned from; None where it does not say."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """train_seconds, env_steps, gradient_updates and trained_paper_literal, where they are known."""

    @property
    def knows_the_world(self) -> bool:
        """It takes a simulator in place of observations, as the planners do, and drives in simulators only."""
        return hasattr(self.policy, "act_in")

    def require_guidance(self, guidance: str | None) -> str:
        """The guidance it drives with: the given one, or its own. Raises UnknownName, ConfigError."""
        chosen = guidance or self.guidance
        if chosen not in GUIDANCE:
            raise UnknownName("guidance", chosen, GUIDANCE)
        possible = getattr(self.policy, "guidances", ("map",) if self.knows_the_world else GUIDANCE)
        if chosen not in possible:
            raise ConfigError(
                f"policy {self.name} does not drive with guidance {chosen}; "
                f"leave guidance out, or give {' or '.join(possible)}"
            )
        return chosen

    def driven(self, robot: str | os.PathLike[str] | RobotConfig | None) -> RobotConfig:
        """The robot that drives: the given one, or its own. Raises AdrlError."""
        return load_robot(robot or self.robot or DEFAULT_ROBOT)

    def taken_as(self, driven: RobotConfig) -> RobotConfig:
        """The robot that drives, as the policy takes it: as_trained, of whatever form the policy is.

        Raises ConfigError for one with the encoder of its own robot inside that would see another one wrong.
        """
        if self.robot is None:
            return driven.slowed(self.stop_within_m)
        taken_as = driven if self.told_of_body else as_trained(driven, self.trained_as or self.robot)
        taken_as = taken_as.slowed(self.stop_within_m)
        if self.encoder_inside:
            require_encodable(
                self.name, self.robot, taken_as, self.encoder.history_steps, body=self.told_of_body
            )
        return taken_as

    @property
    def made_for(self) -> str | None:
        """Name of the robot or family that it was made for; None for any."""
        made_for = self.family or self.robot
        return None if made_for is None else made_for.name

    def strange(self, driven: RobotConfig) -> str | None:
        """A line that says what is other on the robot that drives than on those that it was made for, or None."""
        if self.family is not None:
            return outside_family(self.name, self.family, driven)
        return None if self.robot is None else other_robot(self.name, self.robot, driven)


def find_policy(policy: Any, planners: Mapping[str, Callable[[], Any]] | None = None) -> ResolvedPolicy:
    """A policy by what a user calls it; a ResolvedPolicy is returned as it is.

    A name of SHIPPED, of `planners` (name -> class) or of entry point group "adrl.policies"; a run folder; a file .onnx
    (adrl export) or .zip (Stable-Baselines3); "module:object", where a class or function is called without arguments,
    and modules are found in the working folder too; or an object: see adrl.types.Policy. Raises AdrlError.
    """
    if isinstance(policy, ResolvedPolicy):
        return policy
    if not isinstance(policy, (str, os.PathLike)):
        return _described(policy, None)
    text, planners = os.fspath(policy), planners or {}
    if text in planners:
        return _described(planners[text](), text)
    path = Path(text)
    if text in SHIPPED or path.is_dir():
        return _described(load_policy(resolve_policy(text)), path.name)
    if path.suffix.lower() in FILES:
        return _described(FILES[path.suffix.lower()](path), path.name)
    if ":" in text:
        return _described(_made(text, _imported(text)), text)
    if text in offered("policy"):
        return _described(_made(text, look_up("policy", text, {})), text)
    if os.sep in text:
        resolve_policy(text)  # says that there is no such folder
    raise UnknownName("policy", text, [*SHIPPED, *planners, *offered("policy")])


def act(
    policy: Any, observation: NDArray[np.floating], *, require_finite: bool = True
) -> NDArray[np.float32]:
    """(N, 2) actions of (N, D) observations. Raises ConfigError where the policy fails, or gives something else.

    require_finite: False leaves numbers that are not finite to the caller, as on a robot that has to go on.
    """
    try:
        actions = policy.act(observation)
    except AdrlError:
        raise
    except Exception as error:
        raise ConfigError(
            f"policy {name_of(policy)} cannot act on observations of shape {observation.shape} "
            f"({type(error).__name__}: {error}{_where(error)})"
        ) from error
    return checked_actions(policy, actions, len(observation), require_finite=require_finite)


def begin(policy: Any, rows: NDArray[np.intp]) -> None:
    """Tell a policy that keeps a memory of robots that episodes of `rows` (M,) begin."""
    if not hasattr(policy, "reset"):
        return
    try:
        policy.reset(rows)
    except AdrlError:
        raise
    except Exception as error:
        raise ConfigError(
            f"policy {name_of(policy)}: its reset(rows) failed ({type(error).__name__}: {error}{_where(error)})"
        ) from error


def checked_actions(
    policy: Any, actions: Any, count: int, *, require_finite: bool = True
) -> NDArray[np.float32]:
    """The same actions. Raises ConfigError for what are not (count, 2) finite numbers."""
    try:
        array = np.asarray(actions, dtype=np.float32)
    except (TypeError, ValueError):
        array = np.empty(0, np.float32)
    if array.shape != (count, 2) or (require_finite and not np.isfinite(array).all()):
        raise ConfigError(
            f"policy {name_of(policy)} gave actions of shape {np.shape(array)}, or not finite ones; "
            f"give ({count}, 2) numbers: speed and yaw rate in [-1, 1]"
        )
    return array


def name_of(policy: Any) -> str:
    """What a policy is called: its `name`, or that of its class."""
    name = getattr(policy, "name", None)
    return name if isinstance(name, str) and name else type(policy).__name__


def _described(policy: Any, text: str | None) -> ResolvedPolicy:
    """What is known of a policy. text: what the user called it. Raises AdrlError."""
    if isinstance(policy, MlpPolicy):
        return _trained(policy)
    if not (callable(getattr(policy, "act", None)) or callable(getattr(policy, "act_in", None))):
        raise ConfigError(f"policy {text or repr(policy)} has no act(observation); see docs/guide/policy.md")
    name, robot = name_of(policy), getattr(policy, "robot", None)
    encoder = getattr(policy, "encoder", None)
    if encoder is not None and not isinstance(encoder, (EncoderConfig, Encoder)):
        raise ConfigError(
            f"policy {name}: its encoder is {encoder!r}; give an EncoderConfig, or an object with history_steps and "
            "encode(ranges, goal, twist, last_action, history)"
        )
    own: dict[str, Any] = {
        key: getattr(policy, key)
        for key in (
            "method",
            "plans_itself",
            "told_of_body",
            "encoder_inside",
            "stop_within_m",
            "guidance",
            "replanner",
            "maturity",
            "fingerprint",
            "training_worlds",
        )
        if hasattr(policy, key)
    }
    if hasattr(policy, "act_in"):
        own.setdefault("guidance", "map")
    if not isinstance(own.get("maturity", 0.0), Real):
        raise ConfigError(f"policy {name}: its maturity is {own['maturity']!r}; give a number from 0 to 1")
    if not (robot is None or isinstance(robot, (RobotConfig, RobotFamily, str, os.PathLike))):
        raise ConfigError(
            f"policy {name}: its robot is {robot!r}; give a RobotConfig, or a robot's name or file"
        )
    made_for = None if robot is None else load_robots(robot)
    own.setdefault("told_of_body", isinstance(encoder, EncoderConfig) and encoder.body)
    resolved = ResolvedPolicy(
        policy=policy,
        name=name,
        robot=made_for if isinstance(made_for, RobotConfig) else None,
        family=made_for if isinstance(made_for, RobotFamily) else None,
        encoder=encoder or EncoderConfig(),
        **own,
    )
    resolved.require_guidance(None)
    return resolved


def _trained(policy: MlpPolicy) -> ResolvedPolicy:
    config, setup = policy.config, setup_of(policy)
    extra = config.extra
    return ResolvedPolicy(
        policy=policy,
        name=str(extra.get("run", "policy")),
        method=config.method,
        robot=setup.robot,
        family=setup.family,
        trained_as=setup.trained_as,
        told_of_body=setup.encoder.body,
        stop_within_m=setup.stop_within_m,
        encoder=setup.encoder,
        guidance=config.guidance,
        replanner=setup.replanner,
        maturity=config.maturity,
        fingerprint=policy.fingerprint,
        training_worlds=training_worlds(config),
        training={
            "train_seconds": extra.get("train_seconds"),
            "env_steps": extra.get("env_steps"),
            "gradient_updates": extra.get("gradient_updates"),
            "trained_paper_literal": extra.get("paper_literal"),
        },
    )


def _imported(text: str) -> Any:
    """The object of "module:object". Raises ConfigError, UnknownName."""
    name, _, attribute = text.partition(":")
    if not (
        name and attribute and all(part.isidentifier() for part in (*name.split("."), *attribute.split(".")))
    ):
        raise ConfigError(f"policy {text!r}: give MODULE:OBJECT, such as my_policy:PurePursuit")
    found: Any = _module(text, name)
    for part in attribute.split("."):
        if not hasattr(found, part):
            known = (
                [entry for entry in vars(found) if not entry.startswith("_")]
                if hasattr(found, "__dict__")
                else []
            )
            raise UnknownName(f"object of {name}", part, known)
        found = getattr(found, part)
    return found


def _module(text: str, name: str) -> ModuleType:
    if os.getcwd() not in sys.path:  # commands do not look in the working folder by themselves
        sys.path.insert(0, os.getcwd())
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{name}.".startswith(f"{error.name}."):
            raise ConfigError(
                f"policy {text!r}: no module {error.name} is in the working folder or among the installed packages"
            ) from None
        raise ConfigError(
            f"policy {text!r}: {name} needs the module {error.name}, which is not installed"
        ) from error
    except Exception as error:
        raise ConfigError(
            f"policy {text!r}: {name} cannot be imported ({type(error).__name__}: {error}{_where(error)})"
        ) from error


def _made(text: str, found: Any) -> Any:
    """The policy itself: a class, or a function that makes one, is called."""
    if not callable(found) or (not isinstance(found, type) and hasattr(found, "act")):
        return found
    try:
        return found()
    except AdrlError:
        raise
    except Exception as error:
        raise ConfigError(
            f"policy {text!r}: calling it without arguments failed ({type(error).__name__}: {error}{_where(error)})"
        ) from error


def _where(error: BaseException) -> str:
    """File and line in which an error of a user's code arose, as ", mine.py:12"."""
    frame = error.__traceback__
    while frame is not None and frame.tb_next is not None:
        frame = frame.tb_next
    return "" if frame is None else f", {Path(frame.tb_frame.f_code.co_filename).name}:{frame.tb_lineno}"
