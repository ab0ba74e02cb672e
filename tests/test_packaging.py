"""What goes out as a package is whole, asks for what is there, and installs without what it does not need."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import adrl

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_the_version_is_one() -> None:
    cited = re.search(r'^version: "?([\d.]+)', (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    newest = re.search(r"^## .*?(\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert cited
    assert newest
    assert adrl.__version__ == PROJECT["version"] == cited[1] == newest[1]


def test_hooks_of_a_commit_run_what_make_check_runs() -> None:
    hooks = (ROOT / ".pre-commit-config.yaml").read_text()
    makefile = (
        (ROOT / "Makefile").read_text().replace("$(BIN)", ".venv/bin").replace("$(PY)", ".venv/bin/python")
    )
    entries = re.findall(r"^ +entry: (.+)$", hooks, re.MULTILINE)
    assert len(entries) >= 5
    for entry in entries:
        assert entry in makefile, entry


@pytest.mark.slow
@pytest.mark.timeout(900)  # it compiles the core
@pytest.mark.integration
def test_a_new_environment_evaluates_without_the_extra_train(tmp_path: Path) -> None:
    """Built and installed as by a user, but with the tools that are here: pip alone asks the network."""
    wheels, environment = tmp_path / "wheels", tmp_path / "environment"
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    tools = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    build = [*pip, "wheel", "--no-build-isolation", "--no-deps", "--wheel-dir", str(wheels), str(ROOT)]
    subprocess.run(build, check=True, env=tools)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
    python, (wheel,) = environment / "bin" / "python", wheels.glob("adrl-*.whl")
    constraints = str(ROOT / "constraints.txt")
    subprocess.run([*pip, "--python", str(python), "install", "-c", constraints, str(wheel)], check=True)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(python), *arguments], capture_output=True, text=True, cwd=tmp_path, check=False
        )

    for module in ("jax", "minari", "torch"):
        assert run("-c", f"import {module}").returncode == 1
    listed = run("-m", "adrl.cli", "list")
    assert listed.returncode == 0, listed.stderr
    assert "diffbot" in listed.stdout
    evaluated = run("-m", "adrl.cli", "evaluate", "--policy", "default", "--episodes", "2")
    assert evaluated.returncode == 0, evaluated.stderr
    assert re.search(r"^default +\d", evaluated.stderr, re.MULTILINE)  # stdout is for --json -
    trained = run("-m", "adrl.cli", "train", "--scenario", "clutter", "--steps", "100")
    assert trained.returncode == 2
    assert trained.stderr == ("adrl: error: training needs the extra train; run: pip install 'adrl[train]'\n")
