"""Tunes the constants of SAC and PPO on validation tasks, as those of ADRL were: one seed a trial.

    python docs/tune_baselines.py --method sb3-ppo --trials 60

The first trial has the constants of make_model alone. Every trial is written to docs/results/tuning.json when it ends;
the same command goes on until there are so many. The best ones stand in src/adrl/baselines/tuned.py, copied by hand; a
test holds the two together.
"""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
import optuna
import tyro
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.trial import create_trial

from adrl import files
from adrl.agents.config import TrainConfig
from adrl.agents.metrics import METRICS_FILE
from adrl.comparison.jobs import train_baseline
from adrl.report.metrics_log import read_metrics
from adrl.runs import RunConfig

RESULTS = Path(__file__).parent / "results" / "tuning.json"
VALIDATIONS = 8
"""In each trial; its objective is their mean success: how soon a policy is good counts, and how good it is at last."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to tune, and for how long."""

    method: Literal["sb3-sac", "sb3-ppo"]
    """The baseline."""
    trials: int = 60
    """Trials in all, those of before included."""
    steps: int = 131_072
    """Environment steps of each; another number starts afresh."""
    seed: int = 100
    """Of every trial; no seed of adrl reproduce."""
    scenario: str = "clutter"
    """Where to train, and on whose validation tasks to measure."""
    max_seconds: float | None = None
    """Start no trial after so many s; no limit when left out."""


SPACES: dict[str, dict[str, BaseDistribution]] = {
    "sb3-sac": {
        "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
        "tau": FloatDistribution(2e-3, 2e-2, log=True),
        "n_steps": CategoricalDistribution([1, 3, 5]),
        "ent_coef": CategoricalDistribution(["auto", "auto_0.1", "auto_0.01"]),
        "target_entropy": CategoricalDistribution([-1.0, -2.0, -4.0]),
    },
    "sb3-ppo": {
        "learning_rate": FloatDistribution(1e-4, 3e-3, log=True),
        "n_steps": CategoricalDistribution([16, 32, 64, 128]),
        "batch_size": CategoricalDistribution([128, 256, 512, 1024]),
        "n_epochs": IntDistribution(4, 16),
        "gae_lambda": CategoricalDistribution([0.9, 0.95, 0.98]),
        "clip_range": CategoricalDistribution([0.1, 0.2, 0.3]),
        "ent_coef": FloatDistribution(1e-5, 1e-2, log=True),
    },
}
"""Method -> constructor's arguments to tune, and from what."""
FIRST: dict[str, dict[str, Any]] = {
    # What make_model and the library give, as a point of the space.
    "sb3-sac": {"learning_rate": 1e-3, "tau": 5e-3, "n_steps": 3, "ent_coef": "auto", "target_entropy": -2.0},
    "sb3-ppo": {
        **{"learning_rate": 3e-4, "n_steps": 32, "batch_size": 256, "n_epochs": 10},
        **{"gae_lambda": 0.95, "clip_range": 0.2, "ent_coef": 1e-5},
    },
}


def objective(options: Options, constants: dict[str, Any]) -> float:
    """Mean success of the validations of one training."""
    learner = TrainConfig(
        steps=options.steps, seed=options.seed, eval_interval_steps=options.steps // VALIDATIONS
    )
    config = RunConfig(method="td3", scenario=options.scenario, learner=learner)
    with TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        train_baseline(config, options.method, out, tuned=constants)
        return float(np.nanmean(read_metrics(out / METRICS_FILE)["success"]))


def tune(options: Options, path: Path = RESULTS) -> dict[str, Any]:
    """Run the trials that are missing; returns the best, {"value", "params"}."""
    began_s = time.monotonic()
    content = (
        json.loads(path.read_text(encoding="utf-8"))
        if path.exists()
        else {"schema_version": 1, "studies": {}}
    )
    about = {"scenario": options.scenario, "steps": options.steps, "seed": options.seed}
    study_kept = content["studies"].get(options.method)
    if study_kept is None or study_kept["about"] != about:
        study_kept = {"about": about, "trials": []}
    trials = study_kept["trials"]
    study = optuna.create_study(
        direction="maximize", sampler=optuna.samplers.TPESampler(seed=len(trials), n_startup_trials=8)
    )
    if not trials:
        study.enqueue_trial(FIRST[options.method])
    space = SPACES[options.method]
    for entry in trials:
        study.add_trial(create_trial(params=entry["params"], distributions=space, value=entry["value"]))
    while len(trials) < options.trials and (
        options.max_seconds is None or time.monotonic() - began_s < options.max_seconds
    ):
        trial = study.ask(space)
        constants = trial.params
        trial_began_s = time.monotonic()
        value = objective(options, constants)
        study.tell(trial, value)
        seconds = time.monotonic() - trial_began_s
        trials.append({"value": value, "params": constants, "seconds": round(seconds, 1)})
        best = max(trials, key=lambda entry: entry["value"])
        study_kept |= {"best": best}
        content["studies"][options.method] = study_kept
        files.write_json(path, content)
    return study_kept["best"]


if __name__ == "__main__":
    chosen = tyro.cli(Options)
    print(json.dumps(tune(chosen), indent=2))
