"""adrl export, and the C++ example on what it writes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

from adrl.deploy.plain import to_safetensors
from adrl.types import RobotConfig
from adrl.worlds import ROBOTS
from deploy.recorded import a_policy
from deploy.scan_rows import ScanRows, random_rows
from deploy.test_onnx import ours
from small_run import run_cli

PROJECT = Path(__file__).resolve().parents[2]
TOOLS = Path(sys.executable).parent


@pytest.fixture(scope="module")
def programs() -> Path:
    """Folder of the built example; rebuilt when its sources or the core have changed."""
    build = PROJECT / "build" / "cpp"
    path = f"{TOOLS}{os.pathsep}{os.environ.get('PATH', '')}"
    cmake = shutil.which("cmake", path=path)
    assert cmake is not None, "cmake is one of the developers' tools: make setup"
    for arguments in (["-S", PROJECT / "examples" / "cpp", "-B", build, "-G", "Ninja"], ["--build", build]):
        done = subprocess.run(
            [cmake, *map(str, arguments)],
            env=os.environ | {"PATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
    return build


def lines(rows: ScanRows, *, with_motion: bool) -> str:
    """The rows as adrl_act reads them."""
    parts = [rows.ranges, rows.goal, rows.twist, rows.last_action]
    if with_motion:
        parts += [rows.past_ranges, rows.pose, rows.past_pose]
    return "\n".join(" ".join(f"{n:.17g}" for n in row) for row in np.concatenate(parts, axis=1))


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("history_steps", [0, 5])
@pytest.mark.parametrize("name", ["diffbot", "jackal"])
def test_the_cpp_example_agrees(programs: Path, tmp_path: Path, name: str, history_steps: int):
    robot: RobotConfig = ROBOTS[name]
    policy = a_policy(robot, history_steps=history_steps)
    file = tmp_path / "policy.safetensors"
    file.write_bytes(to_safetensors(policy))
    rows = random_rows(robot, 50, seed=2)
    done = subprocess.run(
        [programs / "adrl_act", file],
        input=lines(rows, with_motion=history_steps > 0),
        capture_output=True,
        text=True,
        check=True,
    )
    theirs = np.array([line.split() for line in done.stdout.splitlines()], dtype=np.float64)
    np.testing.assert_allclose(theirs, ours(policy, robot, rows)[1], atol=1e-5)


@pytest.mark.slow
@pytest.mark.integration
def test_the_cpp_example_drives(programs: Path, tmp_path: Path):
    file = tmp_path / "policy.safetensors"
    assert run_cli("export", "default", "--safetensors", "--out", file) == 0
    done = subprocess.run([programs / "adrl_drive", file], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "at the goal" in done.stdout


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("content", [b"", b"\xff" * 64, b"\x10" + b"\0" * 7 + b'{"a":{"dtype":"F', None])
def test_the_cpp_example_refuses_other_files(programs: Path, tmp_path: Path, content: bytes | None):
    file = tmp_path / "policy.safetensors"
    if content is not None:
        file.write_bytes(content)
    done = subprocess.run(
        [programs / "adrl_act", file], input="", capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stderr.startswith("adrl_act: ")


def test_onnx_by_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "model.onnx"
    assert run_cli("export", "default", "--onnx", "--out", out) == 0
    assert capsys.readouterr().out.strip() == str(out)
    session = onnxruntime.InferenceSession(out, providers=["CPUExecutionProvider"])
    assert session.get_modelmeta().custom_metadata_map["guidance"] == "map"


def test_a_run_folder_keeps_its_model(tmp_path: Path):
    a_policy(ROBOTS["diffbot"]).save(tmp_path / "run")
    assert run_cli("export", tmp_path / "run", "--onnx") == 0
    assert run_cli("export", tmp_path / "run", "--safetensors") == 0
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"policy.onnx", "policy.plain.safetensors"} <= names


@pytest.mark.parametrize(
    "arguments",
    [
        ("default",),
        ("default", "--onnx", "--safetensors"),
        ("default", "--onnx"),
        ("nowhere", "--onnx", "--out", "x"),
    ],
)
def test_what_cannot_be_exported(arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    assert run_cli("export", *arguments) == 2
    assert list(tmp_path.iterdir()) == []
