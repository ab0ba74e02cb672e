"""A run of so many steps that dies at any moment and is resumed reaches the bytes of one that never died."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import resume_run
from adrl.agents import checkpoint
from adrl.agents.budget import BudgetSpent
from adrl.agents.interface import Progress, TrainingStopped, Validation
from adrl.deploy.policy import MlpPolicy, load_policy
from adrl.errors import CheckpointError, ConfigError
from adrl.imitation.probe import record_probe
from probe_envs import Walk
from small_run import contents

STEPS = 600


Outcome = tuple[bytes, list[dict[str, Any]]]


class Killed(BaseException):
    """Stands for the death of the process."""


def outcome(out: Path) -> Outcome:
    """The policy's bytes and the metrics, without what tells the time."""
    rows = [json.loads(line) for line in (out / "metrics.jsonl").read_text().splitlines()]
    for row in rows:
        del row["wall_s"]
    return (out / "policy.safetensors").read_bytes(), rows


@pytest.fixture(scope="module")
def never_killed(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    out = tmp_path_factory.mktemp("whole")
    result = resume_run.run(out, STEPS)
    assert result.env_steps == STEPS
    rows = outcome(out)[1]
    assert rows[-1]["S"] != 0.0
    assert 0 < rows[0]["expert_fraction"] < 1
    return outcome(out)


def run_until(out: Path, calls: int, resume: bool, kind: resume_run.Kind) -> bool:
    """Run and die in the given call of a hook, counted over all of them; False if it ended before."""
    left = calls

    def die(*args: object) -> None:
        nonlocal left
        left -= 1
        if left == 0:
            raise Killed

    def evaluate(policy: MlpPolicy, maturity: float) -> Validation:
        die()
        return resume_run.scored(policy, maturity)

    try:
        resume_run.run(out, STEPS, resume, on_progress=die, evaluate=evaluate, kind=kind)
    except Killed:
        return True
    return False


def die_and_resume(out: Path, seed: int, kind: resume_run.Kind) -> Outcome:
    """What is left of a run that dies at moments drawn with this seed, and is resumed each time."""
    rng = random.Random(seed)
    deaths = 0
    while run_until(out, rng.randint(1, 90), deaths > 0, kind):
        deaths += 1
        assert deaths < 200
    assert deaths >= 2
    return outcome(out)


@pytest.mark.parametrize("seed", range(3))
def test_killed_and_resumed_equals_never_killed(tmp_path: Path, seed: int, never_killed: Outcome):
    assert die_and_resume(tmp_path, seed, resume_run.KINDS["value"]) == never_killed


@pytest.mark.parametrize("name", ["arrivals", "return", "progress", "proposal", "jump-start", "failures"])
def test_so_does_a_run_of_another_kind(tmp_path: Path, name: str, never_killed: Outcome):
    """Released as episodes arrive, by the return, or by its progress; with a guide; with mirrored rows, and rows that
    lead to failures."""
    kind = resume_run.KINDS[name]
    resume_run.run(tmp_path / "whole", STEPS, kind=kind)
    whole = outcome(tmp_path / "whole")
    assert whole[0] != never_killed[0]
    assert whole[1][-1]["S"] != 0.0
    failing = [row["term/failure"] < 0.0 for row in whole[1]]
    assert any(failing) == (name == "failures")
    assert die_and_resume(tmp_path / "killed", 0, kind) == whole


def test_mirror_and_failures_are_in_that_run(tmp_path: Path):
    """Each of them changes what is learnt: the test above would not notice if it were left out."""
    kind = resume_run.KINDS["failures"]
    kinds = kind, replace(kind, mirror=None), replace(kind, failure_share=0.0)
    for i, each in enumerate(kinds):
        resume_run.run(tmp_path / str(i), 120, kind=each)
    assert len({outcome(tmp_path / str(i))[0] for i in range(3)}) == 3


def test_the_best_of_all_that_were_validated_is_left(tmp_path: Path):
    seen: dict[bytes, float] = {}

    def evaluate(policy: MlpPolicy, maturity: float) -> Validation:
        validated = resume_run.scored(policy, maturity)
        seen[policy.layers[1][0].tobytes()] = validated.success
        return validated

    left = resume_run.run(tmp_path, STEPS, evaluate=evaluate, kind=resume_run.KINDS["fine-tuning"]).policy
    assert len(seen) == 1 + STEPS // 120
    assert next(iter(seen)) == resume_run.start().layers[1][0].tobytes()
    assert left.layers[1][0].tobytes() == max(seen, key=lambda layers: seen[layers])
    assert (load_policy(tmp_path).layers[1][0] == left.layers[1][0]).all()


def test_a_finished_run_goes_on_for_longer(tmp_path: Path, never_killed: Outcome):
    resume_run.run(tmp_path, STEPS // 2 + 12)
    resume_run.run(tmp_path, STEPS, resume=True)
    assert outcome(tmp_path)[0] == never_killed[0]
    assert outcome(tmp_path)[1] == never_killed[1]


def test_a_finished_run_needs_a_greater_budget_to_go_on(tmp_path: Path, never_killed: Outcome):
    resume_run.run(tmp_path, STEPS)
    before = contents(tmp_path)
    for steps in (STEPS, STEPS // 2):
        with pytest.raises(BudgetSpent, match=f"steps above {STEPS}"):
            resume_run.run(tmp_path, steps, resume=True)
    assert contents(tmp_path) == before
    assert outcome(tmp_path) == never_killed


def test_a_kill_before_the_policy_was_written_is_mended(tmp_path: Path, never_killed: Outcome):
    """The last checkpoint holds all of the run; its policy is missing, damaged, or that of a shorter run."""
    resume_run.run(tmp_path, STEPS // 2)
    resume_run.run(tmp_path, STEPS, resume=True)
    config, weights = tmp_path / "config.json", tmp_path / "policy.safetensors"
    older = config.read_text().replace(f'"env_steps": {STEPS}', f'"env_steps": {STEPS // 2}')
    for damage in (weights.unlink, lambda: weights.write_bytes(b""), lambda: config.write_text(older)):
        damage()
        resume_run.run(tmp_path, STEPS, resume=True)
        assert outcome(tmp_path) == never_killed


def stop_and_resume(out: Path, seed: int, kind: resume_run.Kind) -> Outcome:
    """What is left of a run that is asked to stop after random numbers of steps, and is resumed each time."""
    rng = random.Random(seed)
    for stops in range(200):
        left = rng.randint(0, 60)

        def stopped() -> bool:
            nonlocal left
            left -= 1
            return left < 0

        try:
            resume_run.run(out, STEPS, stops > 0, kind=kind, stopped=stopped)
        except TrainingStopped:
            continue
        assert stops >= 2
        return outcome(out)
    raise AssertionError("it never ended")


@pytest.mark.parametrize("name", list(resume_run.KINDS))
def test_stopped_and_resumed_equals_never_stopped(tmp_path: Path, name: str):
    kind = resume_run.KINDS[name]
    resume_run.run(tmp_path / "whole", STEPS, kind=kind)
    assert stop_and_resume(tmp_path / "stopped", 1, kind) == outcome(tmp_path / "whole")


def test_a_stopped_run_loses_no_step(tmp_path: Path):
    """Between two checkpoints of the interval, and in the pretraining too."""
    for calls in (1, 10, 40):
        out, count = tmp_path / str(calls), 0

        def stopped(calls: int = calls) -> bool:
            nonlocal count
            count += 1
            return count > calls

        pretraining = 2  # calls: eight updates, four each
        done = max(calls - pretraining, 0) * resume_run.NUM_ENVS
        with pytest.raises(TrainingStopped, match=f"after {done} environment steps.*--resume.*{out}"):
            resume_run.run(out, STEPS, stopped=stopped)
        assert [path.name for path in (out / "checkpoint").iterdir()] == [f"{done:012d}"]
        assert not (out / "policy.safetensors").exists()
        told: list[Progress] = []
        resume_run.run(out, STEPS, resume=True, on_progress=told.append)
        first = next(p.env_steps for p in told if p.phase == "training")
        assert first == (done + resume_run.NUM_ENVS if calls >= pretraining else 0)


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
        patch.setattr(resume_run, "config", lambda steps: replace(original(steps), seed=4))
        with pytest.raises(CheckpointError, match="config"):
            resume_run.run(tmp_path, 240, resume=True)


def test_a_shortened_metrics_log_is_named(tmp_path: Path):
    resume_run.run(tmp_path, 240)
    log = tmp_path / "metrics.jsonl"
    log.write_bytes(log.read_bytes()[:10])
    with pytest.raises(CheckpointError, match=r"metrics\.jsonl"):
        resume_run.run(tmp_path, 480, resume=True)


@pytest.mark.slow
def test_sigkill_and_resume_in_other_processes(tmp_path: Path, never_killed: Outcome):
    tests = Path(__file__).parents[1]
    command = [sys.executable, str(tests / "resume_run.py"), str(tmp_path), str(STEPS)]
    environment = os.environ | {"PYTHONPATH": str(tests)}
    process = subprocess.Popen(command, env=environment)
    deadline = time.monotonic() + 250
    while not checkpoint.exists(tmp_path) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL, "it ended before it could be killed"
    assert not (tmp_path / "policy.safetensors").exists()
    subprocess.run([*command, "resume"], env=environment, check=True, timeout=250)
    assert outcome(tmp_path) == never_killed


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_a_checkpoint(tmp_path: Path, number: int, never_killed: Outcome):
    """Sent before the first step, so that no checkpoint of the interval is there yet."""
    tests = Path(__file__).parents[1]
    command = [sys.executable, str(tests / "resume_run.py"), str(tmp_path), str(STEPS)]
    environment = os.environ | {"PYTHONPATH": str(tests)}
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"started\n"
        process.send_signal(number)
        errors = process.communicate(timeout=250)[1].decode()
    assert process.returncode != 0
    assert "stopping at the next safe point" in errors
    assert "--resume goes on" in errors
    assert checkpoint.exists(tmp_path)
    assert not (tmp_path / "policy.safetensors").exists()
    subprocess.run([*command, "resume"], env=environment, check=True, timeout=250)
    assert outcome(tmp_path) == never_killed
