"""Jobs on a real Ray cluster of this machine: the same results, no disk shared, and what is said when it fails."""

import importlib.util
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from adrl import processes
from adrl.agents.config import Td3Config, TrainConfig
from adrl.comparison.ray_pool import free_core
from adrl.regret.regret import preset, regret, scores
from small_run import run_cli

IN_CI = os.environ.get("CI") == "true"
if not IN_CI and importlib.util.find_spec("ray") is None:
    pytest.skip("Ray is not installed", allow_module_level=True)

SIZES = (
    *("--steps", "1024", "--demonstration-steps", "1024", "--task-pool", "4", "--num-envs", "32"),
    *("--pretrain-updates", "8", "--start-steps", "512", "--td3.widths", "16", "16"),
    *("--log-interval-steps", "512", "--validation-episodes", "2", "--episodes", "4"),
)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A cluster of one machine that listens on loopback only."""
    script = Path(sys.executable).with_name("ray")
    port = 26379 + os.getpid() % 2000
    command = [script, "start", "--head", "--block", "--num-cpus", "2", "--port", str(port)]
    command += ["--node-ip-address", "127.0.0.1", "--include-dashboard", "false", "--disable-usage-stats"]
    command += ["--object-store-memory", str(80 * 2**20)]
    log = tmp_path_factory.mktemp("ray") / "log"
    with open(log, "wb") as stream:
        cluster = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT, start_new_session=True)
    try:
        end = time.monotonic() + 250.0
        while "Ray runtime started" not in log.read_text():
            assert time.monotonic() < end, log.read_text()
            assert cluster.poll() is None, log.read_text()
            time.sleep(0.2)
        yield f"127.0.0.1:{port}"
    finally:
        cluster.terminate()
        cluster.wait(60)


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.ray
def test_the_cluster_gives_the_same_policies_as_processes_here(address: str, tmp_path: Path) -> None:
    """Equal seeds, equal results: what was measured of the policies is equal to the digit."""
    options = ("--methods", "td3", "--seeds", 2, *SIZES)
    assert run_cli("compare", *options, "--ray", address, "--out", tmp_path / "ray") == 0
    assert run_cli("compare", *options, "--workers", 1, "--out", tmp_path / "here") == 0
    for job in ("td3-s0", "td3-s1", "astar-dwa"):
        there, here = (tmp_path / name / job for name in ("ray", "here"))
        assert {path.name for path in there.iterdir()} == {path.name for path in here.iterdir()}
        assert (there / "episodes.parquet").read_bytes() == (here / "episodes.parquet").read_bytes()
    assert not (tmp_path / "ray" / "runs").exists(), "the runs themselves stay on the cluster"

    failing = ("--methods", "adrl", "--seeds", 1, *SIZES, "--dataset", tmp_path / "no-such-dataset")
    assert run_cli("compare", *failing, "--ray", address, "--out", tmp_path / "failed") == 1
    assert "no-such-dataset" in (tmp_path / "failed" / "logs" / "adrl-s0.log").read_text()
    assert (tmp_path / "failed" / "astar-dwa" / "summary.json").exists()


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.ray
def test_regret_runs_there_too(address: str, tmp_path: Path) -> None:
    cell = "slow-dense-clutter-diffbot"
    comparisons = preset(tmp_path / "out", cells=cell, methods="adrl,td3", seeds=1)
    learner = TrainConfig(
        steps=1024, start_steps=512, pretrain_updates=8, eval_interval_steps=1024, td3=Td3Config(widths=(16,))
    )
    sizes = {"episodes": 4, "num_envs": 32, "task_pool": 4, "demonstration_steps": 512}
    tiny = {cell: replace(comparisons[cell], ray=address, learner=learner, validation_episodes=2, **sizes)}
    assert regret(tiny) == {}
    found = scores(tiny)
    assert found is not None
    assert found[0].success.shape == (1, 2, 1)
    assert not (tmp_path / "out" / cell / "runs").exists(), "the runs themselves stay on the cluster"


@pytest.mark.ray
def test_a_cluster_that_is_not_there_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The port of nobody."""
    options = ("--methods", "td3", *SIZES, "--ray", "127.0.0.1:1", "--out", tmp_path / "out")
    assert run_cli("compare", *options) == 2
    assert "no Ray cluster at 127.0.0.1:1" in " ".join(capsys.readouterr().err.split())


def test_two_jobs_of_a_machine_never_share_a_core(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(processes, "usable_cores", lambda: [3, 5])
    with free_core() as first:
        with free_core() as second:
            assert {first, second} == {3, 5}
        with free_core() as again:
            assert again == second, "a core is free again when its job has ended"


def test_without_ray_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "ray" else real(name, *a)
    )
    options = ("--methods", "td3", *SIZES, "--ray", "127.0.0.1:1", "--out", tmp_path / "out")
    assert run_cli("compare", *options) == 2
    assert "adrl[ray]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
