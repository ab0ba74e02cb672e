"""What fine-tuning takes over from the policy that it begins with."""

import math
import os
from dataclasses import dataclass, replace
from typing import Self

from adrl.agents.methods import FOR_EVER, method_name
from adrl.deploy.another_robot import outside_family
from adrl.deploy.policy import MlpPolicy, load_policy, resolve_policy
from adrl.deploy.setup import Setup, setup_of
from adrl.errors import ConfigError
from adrl.observation import EncoderConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.runs.config import RunConfig
from adrl.simulators import NATIVE
from adrl.types import RobotConfig

WARM_UPDATES = 500
"""Updates of the critics before the policy that it begins with may change: cold ones would undo what it can."""
VALIDATION_STEPS = 32_000
"""Environment steps between two validations."""


def beginning_with_a_policy(config: RunConfig) -> RunConfig:
    """Such a run holds the policy until the critics are warm, as cold ones would undo what it can, and validates, as
    the best is kept."""
    learner = config.learner
    learner = replace(learner, critic_warmup_updates=learner.critic_warmup_updates or WARM_UPDATES)
    if learner.eval_interval_steps is None and config.env == NATIVE:
        learner = replace(learner, eval_interval_steps=VALIDATION_STEPS)
    return replace(config, learner=learner)


@dataclass(frozen=True, eq=False, kw_only=True)
class Start:
    """The policy that a run begins with."""

    policy: MlpPolicy
    setup: Setup

    @classmethod
    def of(cls, policy: str | os.PathLike[str]) -> Self:
        """A policy by its folder or its name. Raises CheckpointError."""
        actor = load_policy(resolve_policy(policy))
        return cls(policy=actor, setup=setup_of(actor))

    def strange(self, robot: RobotConfig) -> str | None:
        """A line that says what of the robot the policy's family does not have, or None."""
        name, family = str(self.policy.config.extra.get("run", "policy")), self.setup.family
        return None if family is None else outside_family(name, family, robot)

    def begun(self, config: RunConfig) -> RunConfig:
        """The run that goes on where the policy ended: with its layers and encoder, and its replanner if none is given.

        Raises ConfigError where the run asks for others, or for a method that changes no policy it is given.
        """
        learner, encoder, widths = config.learner, config.encoder, self.policy.config.widths
        if config.resolved().critic_warmup_updates >= FOR_EVER:
            raise ConfigError(
                f"method {method_name(config.chosen_method)!r} clones alone, and fine-tuning would end as it began; "
                "give another method, or leave out fine_tune"
            )
        mine = (encoder.fields(), EncoderConfig().fields()), (learner.td3.widths, type(learner.td3)().widths)
        for name, (given, left_out), own in zip(
            ("encoder", "td3.widths"), mine, (self.setup.encoder.fields(), widths), strict=True
        ):
            if given not in (left_out, own):
                raise ConfigError(
                    f"{name} is {given}, and the policy of fine_tune has {own}; leave {name} out with fine_tune"
                )
        learner = replace(learner, td3=replace(learner.td3, widths=widths))
        replanner = self.setup.replanner if config.replanner == ReplannerConfig() else config.replanner
        if replanner.near is None:  # how it is shown points is part of what it has learnt
            replanner = replace(replanner, near=self.setup.replanner.near)
        stop_within_m = config.stop_within_m
        if stop_within_m is None and math.isfinite(self.setup.stop_within_m):
            stop_within_m = self.setup.stop_within_m
        config = replace(
            config,
            encoder=self.setup.encoder,
            replanner=replanner,
            stop_within_m=stop_within_m,
            learner=learner,
        )
        return beginning_with_a_policy(config)
