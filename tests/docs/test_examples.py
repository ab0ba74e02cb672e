"""What the pages show is run, page by page, as a reader would: in a folder of its own, from top to bottom.

python and sh blocks are run; blocks whose title is a file's name are written to it first. A block without a language
is only shown: its commands take minutes.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "docs" / "quickstart.md", *sorted((ROOT / "docs" / "guide").glob("*.md"))]
BLOCK = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)
SMALLER = {"max_seconds=60": "steps=2048", "episodes=500": "episodes=5"}
"""What makes the README's example one of seconds."""


def script(text: str, folder: Path) -> str:
    """A page's blocks as one program; its files go to the folder."""
    lines = []
    for language, title, body in BLOCK.findall(text):
        if title and " " not in title:
            (folder / title).write_text(body)
        elif language == "python":
            lines.append(body)
        elif language == "sh":
            lines.append("from adrl.cli import main")
            lines += [f"assert main({shlex.split(line)[1:]}) == 0" for line in body.splitlines()]
    return "\n".join(lines)


def run(program: str, folder: Path) -> str:
    """What the program prints. It finds modules in the folder, and wastes no time on threads."""
    file = folder / "page.py"
    file.write_text(program)
    done = subprocess.run(
        [sys.executable, file],
        cwd=folder,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.integration
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_examples_of_a_page_run(page: Path, tmp_path: Path) -> None:
    program = script(page.read_text(encoding="utf-8"), tmp_path)
    assert program, "no example in this page"
    run(program, tmp_path)


@pytest.mark.slow
@pytest.mark.integration
def test_the_readme_s_example_runs_at_a_smaller_size(tmp_path: Path) -> None:
    program = script((ROOT / "README.md").read_text(encoding="utf-8"), tmp_path)
    for shown, run_here in SMALLER.items():
        assert program.count(shown) == 1, f"README.md no longer says {shown}"
        program = program.replace(shown, run_here)
    success, low, high = map(float, run(program, tmp_path).split())
    assert low <= success <= high
