"""A small run with everything in it, for test_resume.py. As a script: resume_run.py OUT STEPS [resume]."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from adrl.agents.config import Td3Config, TrainConfig
from adrl.agents.interface import Evaluate, Progress, TrainResult, Validation
from adrl.agents.train import train
from adrl.imitation.demonstrations import Demonstrations
from adrl.imitation.probe import record_probe
from adrl.imitation.schedule import ScheduleConfig
from probe_envs import PLAIN, Walk, record_demonstrations

NUM_ENVS = 4
VALIDATION = Validation(success=0.5, start=np.zeros((3, 2), np.float32), discounted_return=0.25)


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
        schedule=ScheduleConfig(warmup_updates=12, interval_updates=8, rise_updates=100),
        reward=PLAIN,
    )


def demonstrations() -> Demonstrations:
    return record_demonstrations(Walk(NUM_ENVS), 25)


def run(
    out: Path,
    steps: int,
    resume: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
    evaluate: Evaluate | None = None,
) -> TrainResult:
    return train(
        config(steps),
        Walk(NUM_ENVS),
        out,
        demonstrations=demonstrations(),
        probe=record_probe(Walk(NUM_ENVS), seed=7, max_steps=20),
        evaluate=evaluate or (lambda policy, maturity: VALIDATION),
        on_progress=on_progress,
        resume=resume,
    )


if __name__ == "__main__":
    run(Path(sys.argv[1]), int(sys.argv[2]), resume="resume" in sys.argv)
