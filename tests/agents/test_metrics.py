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
from adrl.agents.config import TrainConfig
from adrl.agents.metrics import EpisodeTally, MetricsLog, crossed, reward_row, spent_fraction
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


def test_a_run_reports_every_key(tmp_path: Path):
    resume_run.run(tmp_path, 300)
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
        def step(self, actions: NDArray[np.float32]) -> Any:
            told.append(self.maturity)
            return super().step(actions)

    result = resume_run.run(tmp_path, 300, kind=resume_run.Kind(env=Listening))
    rows = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert [told[row["env_steps"] // 4 - 1] for row in rows] == [row["S"] for row in rows]
    assert told[0] == 0.0 < told[-1] == result.policy.config.maturity


def test_a_budget_of_time_ends_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    td3 = resume_run.config(1).td3
    timed = TrainConfig(max_seconds=0.5, td3=td3, pretrain_updates=0, replay_capacity=1000)
    monkeypatch.setattr(resume_run, "config", lambda steps: timed)
    result = resume_run.run(tmp_path, 0)
    assert 0.5 <= result.train_seconds < 30.0
    assert (tmp_path / "policy.safetensors").exists()


def test_a_run_whose_budget_is_spent_before_its_first_step_says_so_in_one_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A comparison reads every log: one without a row would keep it from its tables."""
    spent = replace(resume_run.config(1), steps=None, max_seconds=1e-9)
    monkeypatch.setattr(resume_run, "config", lambda steps: spent)
    for resume in (False, True):
        assert resume_run.run(tmp_path, 0, resume=resume).env_steps == 0
        columns = read_metrics(tmp_path / "metrics.jsonl")
        assert (columns["env_steps"].tolist(), columns["updates"].tolist()) == ([0.0], [0.0])


def test_a_run_without_an_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(resume_run, "config", lambda steps: TrainConfig())
    with pytest.raises(ConfigError, match="steps or max_seconds"):
        resume_run.run(tmp_path, 0)
    assert not list(tmp_path.iterdir())


def test_tally_means_finished_episodes():
    tally = EpisodeTally.empty(3)
    none = np.zeros(3, bool)
    assert len(tally.add(f32([1, 2, 3]), none, none, 0.5)) == 0
    assert tally.take() == {"return_mean": None, "train_success": None}
    returns = tally.add(f32([1, 1, 1]), np.array([True, False, True]), np.array([True, False, False]), 0.5)
    assert_allclose(returns, [((1.0 + 0.5 * 1.0) + 1.0) / 2, ((3.0 + 0.5 * 1.0) + 1.0) / 2])
    assert tally.take() == {"return_mean": (2.0 + 4.0) / 2, "train_success": 0.5}
    returns = tally.add(f32([5, 5, 5]), np.array([True, True, False]), np.array([True, True, True]), 0.5)
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
    assert spent_fraction(50, 3.0, 100, None) == 0.5
    assert spent_fraction(50, 3.0, None, 4.0) == 0.75
    assert spent_fraction(50, 3.0, 100, 4.0) == 0.75
    assert spent_fraction(90, 3.0, 100, 4.0) == 0.9
    assert spent_fraction(0, 0.0, 100, 4.0) == 0.0
    assert spent_fraction(101, 5.0, 100, 4.0) == 1.0


def test_the_log_does_not_import_pytorch(tmp_path: Path):
    program = (
        "import sys; from pathlib import Path; from adrl.agents.metrics import MetricsLog; "
        f"MetricsLog(Path({str(tmp_path)!r})).close(); sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], timeout=60).returncode == 0
