"""A small run with everything in it, for test_resume.py. As a script: resume_run.py OUT STEPS [resume]."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from adrl.agents.config import Guide, Td3Config, TrainConfig
from adrl.agents.interface import Evaluate, Progress, TrainResult, Validation
from adrl.agents.train import train
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.imitation.demonstrations import Demonstrations
from adrl.imitation.probe import record_probe
from adrl.imitation.schedule import Driver, Rise, ScheduleConfig
from adrl.observation import Mirror
from adrl.signals import stop_requests
from probe_envs import PLAIN, Stumble, Walk, record_demonstrations

NUM_ENVS = 4
VALIDATION = Validation(success=0.5, seconds=9.0, start=np.zeros((3, 2), np.float32), discounted_return=0.25)


@dataclass(frozen=True)
class Kind:
    """What a run has beside config()."""

    driver: Driver = "value"
    rise: Rise = "steady"
    guide: Guide = "none"
    env: type[Walk] = Walk
    failure_share: float = 0.0
    mirror: Mirror | None = None
    keep_best: bool = False


KINDS = {
    "value": Kind(),
    "arrivals": Kind(rise="arrivals"),
    "return": Kind(driver="return"),
    "progress": Kind(driver="progress"),
    "proposal": Kind(guide="proposal"),
    "jump-start": Kind(guide="jump-start"),
    "fine-tuning": Kind(keep_best=True),
    "failures": Kind(
        env=Stumble, failure_share=0.5, mirror=Mirror(np.array([0, 1]), np.array([-1.0, 1.0], np.float32))
    ),
}


def config(steps: int) -> TrainConfig:
    return TrainConfig(
        steps=steps,
        seed=3,
        start_steps=40,
        pretrain_updates=8,
        critic_warmup_updates=20,
        replay_capacity=300,
        log_interval_steps=60,
        eval_interval_steps=120,
        checkpoint_interval_steps=100,
        td3=Td3Config(widths=(16, 16), batch_size=16, bc_batch_size=8),
        schedule=ScheduleConfig(warmup_updates=12, interval_updates=8, rise_updates=100, lambda_floor=0.1),
        reward=PLAIN,
    )


def start() -> MlpPolicy:
    """A policy to begin with."""
    sizes = 2, 16, 16, 2
    rng = np.random.default_rng(0)
    layers = [
        (rng.normal(0.0, 0.3, (i, o)).astype(np.float32), np.zeros(o, np.float32)) for i, o in pairwise(sizes)
    ]
    return MlpPolicy(layers, PolicyConfig(input_size=2, widths=(16, 16), maturity=0.25))


def scored(policy: MlpPolicy, maturity: float) -> Validation:
    """A score that follows from the policy alone, and differs from one to the next."""
    success = float(np.abs(policy.layers[1][0]).sum()) % 1.0
    return replace(VALIDATION, success=success)


def demonstrations() -> Demonstrations:
    return record_demonstrations(Walk(NUM_ENVS), 25)


def run(
    out: Path,
    steps: int,
    resume: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
    evaluate: Evaluate | None = None,
    kind: Kind = KINDS["value"],
    stopped: Callable[[], bool] = lambda: False,
) -> TrainResult:
    base = config(steps)
    schedule = replace(base.schedule, driver=kind.driver, rise=kind.rise)
    return train(
        replace(base, schedule=schedule, failure_share=kind.failure_share, guide=kind.guide),
        kind.env(NUM_ENVS),
        out,
        demonstrations=demonstrations(),
        probe=record_probe(Walk(NUM_ENVS), seed=7, max_steps=20),
        mirror=kind.mirror,
        start=start() if kind.keep_best else None,
        keep_best=kind.keep_best,
        evaluate=evaluate or scored,
        on_progress=on_progress,
        resume=resume,
        stopped=stopped,
    )


if __name__ == "__main__":
    with stop_requests() as stop:
        sys.stdout.write("started\n")
        sys.stdout.flush()
        run(Path(sys.argv[1]), int(sys.argv[2]), resume="resume" in sys.argv, stopped=stop)
