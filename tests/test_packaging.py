"""What goes out as a package says the same everywhere."""

import re
import tomllib
from pathlib import Path

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
