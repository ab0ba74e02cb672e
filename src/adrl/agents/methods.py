"""Training methods: each is a delta of a few lines on the learner's configuration."""

from collections.abc import Callable
from dataclasses import replace

from adrl.agents.config import TrainConfig
from adrl.errors import UnknownName


def adrl(config: TrainConfig) -> TrainConfig:
    """The paper's method: expert share, cloning weight and reward weights all follow the critic's maturity."""
    return config


def td3(config: TrainConfig) -> TrainConfig:
    """TD3 on the same reward with static weights, without demonstrations."""
    schedule = replace(config.schedule, alpha_min=0.0, alpha_max=0.0, lambda_max=0.0)
    return replace(config, schedule=schedule, pretrain_updates=0, critic_warmup_updates=0)


METHODS: dict[str, Callable[[TrainConfig], TrainConfig]] = {"adrl": adrl, "td3": td3}

WITHOUT_DEMONSTRATIONS = frozenset({"td3"})


def method_config(name: str, config: TrainConfig) -> TrainConfig:
    """The configuration of a method. Raises UnknownName with the nearest one."""
    if name not in METHODS:
        raise UnknownName("method", name, METHODS)
    return METHODS[name](config)
