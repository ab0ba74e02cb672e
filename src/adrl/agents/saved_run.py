"""What a checkpoint says of a run beside its arrays, and what a run that goes on must share with it."""

import json
from typing import Annotated, Any, NotRequired, TypedDict

from msgspec import Meta

from adrl.agents.config import Td3Config, TrainConfig
from adrl.deploy.policy import PolicyConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import with_defaults, without_constants

Count = Annotated[int, Meta(ge=0)]

BEFORE: dict[str, Any] = {"schedule": {"lambda_floor": 0.0}}
"""What was done before these options came, where it is not their default."""
LEFT_OUT = {"seed", "steps", "max_seconds"}
"""Options that some files leave out on purpose."""


class Tally(TypedDict, total=False):
    """Numbers of metrics.EpisodeTally."""

    finished: Count
    succeeded: Count
    return_sum: float
    total: Count


class Curriculum(TypedDict, total=False):
    """Numbers of jump_start.JumpStart."""

    horizon: Annotated[float, Meta(ge=0.0)]
    awaited: list[Count]
    stage: Count
    succeeded: Count
    windows: Count
    average: float
    best: float


class BestOfRun(TypedDict):
    """Numbers of best.Best."""

    start: tuple[Count, float, float]
    kept: tuple[Count, float, float]
    maturity: float


class SavedRun(TypedDict):
    """A checkpoint's state.json."""

    config: dict[str, Any]
    rng: dict[str, Any]
    learner: dict[str, Any]
    tally: Tally
    env_steps: Count
    logged_at: Count
    validated_at: NotRequired[Count]
    """Absent from checkpoints before there was a last one."""
    train_success: float | None
    success: float | None
    returns: list[float]
    arrived: NotRequired[list[bool]]
    """Absent from checkpoints before S could rise with arrivals."""
    explorer: NotRequired[Curriculum]
    """Of exploration.Explorer; absent from checkpoints before methods had a guide."""
    best: NotRequired[BestOfRun]
    """Of best.Best, in a run that keeps its best policy."""
    wall_s: Annotated[float, Meta(ge=0.0)]
    metrics_bytes: Count


def identity(config: TrainConfig, policy: PolicyConfig) -> dict[str, Any]:
    """What a resumed run must share with the one it goes on with, as JSON gives it back."""
    about = {"robot": policy.robot, "encoder": policy.encoder, "guidance": policy.guidance}
    about |= {"family": policy.family} if policy.family else {}
    about |= {"method": policy.method, "environment": policy.extra.get("environment")}
    return json.loads(json.dumps(config.comparable() | about, default=str))


def identity_of_before(saved: dict[str, Any]) -> dict[str, Any]:
    """An identity that an earlier version wrote, as today's are."""
    environment = dict(saved.get("environment") or {})
    if "replanner" in environment:
        known = without_constants(ReplannerConfig, environment["replanner"])
        environment["replanner"] = with_defaults(ReplannerConfig, known)
        saved = saved | {"environment": environment}
    return learner_of_before(saved)


def learner_of_before(saved: dict[str, Any]) -> dict[str, Any]:
    """A learner's configuration that an earlier version wrote, without its budget: without what is constant now, and
    with the options that came later. Raises CheckpointError as without_constants does."""
    td3 = saved.get("td3")
    if isinstance(td3, dict) and td3.get("q_filter") is True:
        saved = saved | {"td3": td3 | {"q_filter": Td3Config.q_filter, "row_weights": "q-filter"}}
    sections = {n: options | saved[n] for n, options in BEFORE.items() if isinstance(saved.get(n), dict)}
    filled = with_defaults(TrainConfig, without_constants(TrainConfig, saved | sections))
    known = {name: value for name, value in filled.items() if name in saved or name not in LEFT_OUT}
    return json.loads(json.dumps(known, default=str))
