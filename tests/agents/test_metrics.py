"""The run's log: strict JSON, the keys every reader relies on, and means that are means."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

import resume_run
from adrl.agents.budget import BudgetSpent, require_updates, spent_fraction
from adrl.agents.config import TrainConfig
from adrl.agents.interface import Progress, Validation
from adrl.agents.metrics import EpisodeTally, MetricsLog, crossed, reward_row
from adrl.deploy.policy import MlpPolicy
from adrl.errors import CheckpointError, ConfigError
from adrl.report.metrics_log import read_metrics
from adrl.rewards import REWARD_TERMS, RewardConfig, weights
from probe_envs import Walk


def f32(values: list[float]) -> NDArray[np.float32]:
    return np.array(values, np.float32)


KEYS = {
    "wall_s",
    "env_steps",
    "updates",
    "episode",
    "S",
    "alpha",
    "lambda_bc",
    "q_mean",
    "return_mean",
    "expert_fraction",
    "success",
    "overestimation",
}


def test_rows_are_strict_json(tmp_path: Path):
    log = MetricsLog(tmp_path)
    log.write({"env_steps": 1, "a": float("nan"), "b": None, "c": 0.5, "d": float("inf")})
    log.close()
    row = json.loads((tmp_path / "metrics.jsonl").read_text(), parse_constant=pytest.fail)
    assert row == {"env_steps": 1, "a": None, "b": None, "c": 0.5, "d": None}


def test_what_a_killed_run_wrote_after_its_checkpoint_goes(tmp_path: Path):
    log = MetricsLog(tmp_path)
    log.write({"env_steps": 1})
    kept = log.position()
    log.write({"env_steps": 2})
    log.close()
    log = MetricsLog(tmp_path, kept, 1)
    log.write({"env_steps": 3})
    log.close()
    rows = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert [row["env_steps"] for row in rows] == [1, 3]
    with pytest.raises(CheckpointError, match=r"metrics\.jsonl"):
        MetricsLog(tmp_path, 10_000, 1)


def alike(policy: MlpPolicy, maturity: float) -> Validation:
    """The same of every policy."""
    return resume_run.VALIDATION


def test_a_run_reports_every_key(tmp_path: Path):
    resume_run.run(tmp_path, 300, evaluate=alike)
    rows = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert [row["env_steps"] for row in rows] == [60, 120, 180, 240, 300]
    for row in rows:
        assert row.keys() >= (KEYS if row["success"] is not None else KEYS - {"overestimation"})
        assert row.keys() >= {f"{kind}/{name}" for kind in ("term", "weight") for name in REWARD_TERMS}
    assert [row["success"] for row in rows] == [None, 0.5, None, 0.5, None]
    for row in rows:
        if row["success"] is not None:
            assert row["return_start"] == resume_run.VALIDATION.discounted_return
            assert_allclose(row["overestimation"], row["q_start"] - row["return_start"])
    assert rows[-1]["episode"] == 4 * (300 // 4 // 10)  # four rows, ten steps an episode
    for row in rows:
        assert_allclose(row["expert_fraction"], row["alpha"], atol=0.5 / 16)
    assert list((tmp_path / "tb").iterdir())


def test_the_environment_is_told_s_before_each_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Its replanner's thresholds follow S (eq 20), as they will with the policy that is saved."""
    told: list[float] = []

    class Listening(Walk):
        def advance(self, actions: NDArray[np.float32]) -> Any:
            told.append(self.maturity)
            return super().advance(actions)

    result = resume_run.run(tmp_path, 300, kind=resume_run.Kind(env=Listening))
    rows = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert [told[row["env_steps"] // 4 - 1] for row in rows] == [row["S"] for row in rows]
    assert told[0] == 0.0 < told[-1] == result.policy.config.maturity


class Clock:
    """Time that passes only in steps of the environment, a second each; stands for the module time."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


def test_a_budget_of_time_is_a_total_and_ends_the_run_with_the_step_that_spends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Set-up counts, validation does not, and a resumed run has what is left."""
    clock = Clock()

    class Slow(Walk):
        def reset(self, **options: Any) -> Any:
            clock.now_s += 10.0
            return super().reset(**options)

        def advance(self, actions: NDArray[np.float32]) -> Any:
            clock.now_s += 1.0
            return super().advance(actions)

    def validate(policy: MlpPolicy, maturity: float) -> Validation:
        clock.now_s += 1000.0
        return resume_run.VALIDATION

    kind = resume_run.Kind(env=Slow)
    monkeypatch.setattr("adrl.agents.train.time", clock)
    for max_seconds, wanted in ((50.0, 40), (90.0, 70)):  # set-up takes ten, each time anew
        timed = replace(resume_run.config(1), steps=None, max_seconds=max_seconds)
        monkeypatch.setattr(resume_run, "config", lambda steps, timed=timed: timed)
        result = resume_run.run(tmp_path, 0, resume=max_seconds > 50.0, evaluate=validate, kind=kind)
        assert result.env_steps == wanted * resume_run.NUM_ENVS
        assert result.train_seconds == max_seconds
    with pytest.raises(BudgetSpent, match="max-seconds above 100"):
        resume_run.run(tmp_path, 0, resume=True, evaluate=validate, kind=kind)


def test_no_policy_without_updates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A budget that ends in set-up, or before start_steps; what is given instead makes one."""
    base = resume_run.config(1)
    nothing = replace(base, pretrain_updates=0, start_steps=100, steps=80)
    for tried, says in (
        (replace(base, steps=None, max_seconds=1e-9), "set-up took"),
        (nothing, r"80 environment steps.*start_steps = 100"),
    ):
        monkeypatch.setattr(resume_run, "config", lambda steps, tried=tried: tried)
        for resume in (False, True):
            with pytest.raises(ConfigError, match=says):
                resume_run.run(tmp_path, 0, resume=resume)
        assert not (tmp_path / "policy.safetensors").exists()
    enough = replace(nothing, steps=120)
    monkeypatch.setattr(resume_run, "config", lambda steps: enough)
    assert resume_run.run(tmp_path, 0, resume=True).updates > 0


def test_updates_on_demonstrations_alone_make_no_policy():
    """Time that ends in pretraining leaves a policy that has made no step."""
    timed = TrainConfig(max_seconds=3.0, steps=None)
    with pytest.raises(ConfigError, match=r"set-up took 2\.5 s.*first step"):
        require_updates(timed, updates=4, env_steps=0, setup_s=2.5)
    require_updates(timed, updates=4, env_steps=64, setup_s=2.5)


def test_the_last_validation_is_of_the_last_policy(tmp_path: Path):
    for steps in (60, 100, 240):
        out = tmp_path / str(steps)
        resume_run.run(out, steps, evaluate=alike)
        columns = read_metrics(out / "metrics.jsonl")
        assert columns["env_steps"][-1] == steps
        assert columns["success"][-1] == resume_run.VALIDATION.success


def test_progress_tells_each_phase_and_ends_at_one(tmp_path: Path):
    told: list[Progress] = []
    resume_run.run(tmp_path, 240, on_progress=told.append)
    phases = [p.phase for p in told]
    assert phases[0] == "compilation"
    assert phases.count("compilation") == 1
    assert set(phases) == {"compilation", "training", "validation"}
    assert [p.env_steps for p in told if p.phase == "validation"] == [120, 240]
    fractions = [p.fraction for p in told]
    assert fractions == sorted(fractions)
    assert (told[-1].fraction, told[-1].env_steps) == (1.0, 240)


def test_a_run_without_an_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(resume_run, "config", lambda steps: TrainConfig())
    with pytest.raises(ConfigError, match="steps or max_seconds"):
        resume_run.run(tmp_path, 0)
    assert not list(tmp_path.iterdir())


def test_tally_means_finished_episodes():
    tally = EpisodeTally.empty(3)
    none, half = np.zeros(3, bool), np.full(3, 0.5)
    assert len(tally.add(f32([1, 2, 3]), none, none, half)) == 0
    assert tally.take() == {"return_mean": None, "train_success": None}
    returns = tally.add(f32([1, 1, 1]), np.array([True, False, True]), np.array([True, False, False]), half)
    assert_allclose(returns, [((1.0 + 0.5 * 1.0) + 1.0) / 2, ((3.0 + 0.5 * 1.0) + 1.0) / 2])
    assert tally.take() == {"return_mean": (2.0 + 4.0) / 2, "train_success": 0.5}
    returns = tally.add(f32([5, 5, 5]), np.array([True, True, False]), np.array([True, True, True]), half)
    second = ((2.0 + 0.5 * 1.0 + 0.25 * 5.0) + (1.0 + 0.5 * 5.0) + 5.0) / 3
    assert_allclose(returns, [5.0, second])
    assert tally.take() == {"return_mean": (5.0 + 8.0) / 2, "train_success": 1.0}
    assert tally.total == 4


def test_reward_rows_are_means():
    rng = np.random.default_rng(0)
    terms, features = rng.normal(size=(4, 5, 6)), rng.random((4, 5, 3))
    row = reward_row(terms.astype(np.float32), features.astype(np.float32), 0.3, RewardConfig())
    assert_allclose(row["term/obstacle"], terms[..., 4].mean(), rtol=1e-4)
    expected = weights(features, 0.3, RewardConfig())[..., 5].mean()
    assert_allclose(row["weight/stagnation"], expected, rtol=1e-4)


@pytest.mark.parametrize("step", [1, 7, 64])
@pytest.mark.parametrize("interval", [1, 10, 64, 100])
def test_an_interval_is_due_once_for_each_multiple_that_steps_pass(step: int, interval: int):
    ends = range(step, 40 * step + 1, step)
    due = [end for end in ends if crossed(end, step, interval)]
    assert due == [end for end in ends if any(k % interval == 0 for k in range(end - step + 1, end + 1))]
    assert not any(crossed(end, step, None) for end in ends)


def test_the_budget_that_is_spent_first_counts():
    assert spent_fraction(TrainConfig(steps=100, max_seconds=None), 50, 3.0) == 0.5
    assert spent_fraction(TrainConfig(steps=None, max_seconds=4.0), 50, 3.0) == 0.75
    assert spent_fraction(TrainConfig(steps=100, max_seconds=4.0), 50, 3.0) == 0.75
    assert spent_fraction(TrainConfig(steps=100, max_seconds=4.0), 90, 3.0) == 0.9
    assert spent_fraction(TrainConfig(steps=100, max_seconds=4.0), 0, 0.0) == 0.0
    assert spent_fraction(TrainConfig(steps=100, max_seconds=4.0), 101, 5.0) == 1.0


def test_the_log_does_not_import_pytorch(tmp_path: Path):
    program = (
        "import sys; from pathlib import Path; from adrl.agents.metrics import MetricsLog; "
        f"MetricsLog(Path({str(tmp_path)!r})).close(); sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], timeout=60).returncode == 0
