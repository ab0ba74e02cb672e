"""A run of so many steps that dies at any moment and is resumed reaches the bytes of one that never died."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import resume_run
from adrl.agents import checkpoint
from adrl.errors import CheckpointError, ConfigError
from adrl.imitation.probe import record_probe
from probe_envs import Walk

STEPS = 600


class Killed(BaseException):
    """Stands for the death of the process."""


def outcome(out: Path) -> tuple[bytes, list[dict[str, object]]]:
    """The policy's bytes and the metrics, without what tells the time."""
    rows = [json.loads(line) for line in (out / "metrics.jsonl").read_text().splitlines()]
    for row in rows:
        del row["wall_s"]
    return (out / "policy.safetensors").read_bytes(), rows


@pytest.fixture(scope="module")
def never_killed(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[dict[str, object]]]:
    out = tmp_path_factory.mktemp("whole")
    result = resume_run.run(out, STEPS)
    assert result.env_steps == STEPS
    rows = outcome(out)[1]
    assert rows[-1]["S"] != 0.0
    assert 0 < rows[0]["expert_fraction"] < 1  # pyright: ignore[reportOperatorIssue]
    return outcome(out)


def run_until(out: Path, calls: int, resume: bool) -> bool:
    """Run and die in the given call of a hook, counted over all of them; False if it ended before."""
    left = calls

    def die(*args: object) -> Any:
        nonlocal left
        left -= 1
        if left == 0:
            raise Killed
        return resume_run.VALIDATION

    try:
        resume_run.run(out, STEPS, resume, on_progress=die, evaluate=die)
    except Killed:
        return True
    return False


@pytest.mark.parametrize("seed", range(3))
def test_killed_and_resumed_equals_never_killed(
    tmp_path: Path, seed: int, never_killed: tuple[bytes, list[dict[str, object]]]
):
    rng = random.Random(seed)
    deaths = 0
    while run_until(tmp_path, rng.randint(1, 90), resume=deaths > 0):
        deaths += 1
        assert deaths < 200
    assert deaths >= 2
    assert outcome(tmp_path) == never_killed


def test_a_finished_run_goes_on_for_longer(
    tmp_path: Path, never_killed: tuple[bytes, list[dict[str, object]]]
):
    resume_run.run(tmp_path, STEPS // 2 + 12)
    resume_run.run(tmp_path, STEPS, resume=True)
    assert outcome(tmp_path)[0] == never_killed[0]
    assert outcome(tmp_path)[1] == never_killed[1]


def test_resuming_a_finished_run_changes_nothing(
    tmp_path: Path, never_killed: tuple[bytes, list[dict[str, object]]]
):
    resume_run.run(tmp_path, STEPS)
    resume_run.run(tmp_path, STEPS, resume=True)
    assert outcome(tmp_path) == never_killed


def test_a_run_folder_is_not_overwritten(tmp_path: Path):
    resume_run.run(tmp_path, 120)
    with pytest.raises(ConfigError, match="resume"):
        resume_run.run(tmp_path, 120)


def test_other_data_or_settings_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    resume_run.run(tmp_path, 120)
    with monkeypatch.context() as patch:
        patch.setattr(resume_run, "record_probe", lambda *a, **k: record_probe(Walk(4), seed=8, max_steps=20))
        with pytest.raises(CheckpointError, match=r"checkpoint/000000000120: .*probe"):
            resume_run.run(tmp_path, 240, resume=True)
    with monkeypatch.context() as patch:
        original = resume_run.config
        patch.setattr(resume_run, "config", lambda steps: original(steps).__class__(steps=steps, seed=4))
        with pytest.raises(CheckpointError, match="config"):
            resume_run.run(tmp_path, 240, resume=True)


def test_a_shortened_metrics_log_is_named(tmp_path: Path):
    resume_run.run(tmp_path, 240)
    log = tmp_path / "metrics.jsonl"
    log.write_bytes(log.read_bytes()[:10])
    with pytest.raises(CheckpointError, match=r"metrics\.jsonl"):
        resume_run.run(tmp_path, 480, resume=True)


@pytest.mark.slow
def test_sigkill_and_resume_in_other_processes(
    tmp_path: Path, never_killed: tuple[bytes, list[dict[str, object]]]
):
    tests = Path(__file__).parents[1]
    command = [sys.executable, str(tests / "resume_run.py"), str(tmp_path), str(STEPS)]
    environment = os.environ | {"PYTHONPATH": str(tests)}
    process = subprocess.Popen(command, env=environment)
    deadline = time.monotonic() + 120
    while not checkpoint.exists(tmp_path) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL, "it ended before it could be killed"
    assert not (tmp_path / "policy.safetensors").exists()
    subprocess.run([*command, "resume"], env=environment, check=True, timeout=120)
    assert outcome(tmp_path) == never_killed
