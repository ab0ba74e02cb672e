"""What the pages show is run, page by page, as a reader would: in a folder of its own, from top to bottom.

python and sh blocks are run; blocks whose title is a file's name are written to it first. Those with the title "with
Gazebo" are run where Gazebo is, and in CI. A block without a language is only shown: its commands take minutes, or need
a real robot.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from adrl.deploy.policy import resolve_policy
from adrl.integrations.gazebo.server import is_installed

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "docs" / "quickstart.md", *sorted((ROOT / "docs" / "guide").glob("*.md"))]
HOW_TO = [ROOT / "docs" / "how-to" / f"{name}.md" for name in ("any-robot", "bags", "gazebo", "robot")]
BLOCK = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)
SMALLER = {"max_seconds=60": "steps=2048", "episodes=500": "episodes=5"}
"""What makes the example of the commands' page one of seconds."""
WITH_GAZEBO = is_installed() or os.environ.get("CI") == "true"


def script(text: str, folder: Path) -> str:
    """A page's blocks as one program; its files go to the folder."""
    lines = ["import subprocess", "from adrl.cli import main"]
    for language, title, body in BLOCK.findall(text):
        if title == "with Gazebo" and not WITH_GAZEBO:
            continue
        if title and " " not in title:
            (folder / title).write_text(body)
        elif language == "python":
            lines.append(body)
        elif language == "sh":
            lines += [as_python(line) for line in body.replace("\\\n", " ").splitlines()]
    return "\n".join(lines) if len(lines) > 2 else ""


def as_python(line: str) -> str:
    """A command; adrl's are run in the page's own process, which saves its start."""
    words = shlex.split(line, comments=True)
    if words[:1] == ["adrl"]:
        return f"assert main({words[1:]}) == 0"
    return f"subprocess.run({line!r}, shell=True, check=True)"


def run(program: str, folder: Path) -> str:
    """What the program prints. It finds modules in the folder, and wastes no time on threads."""
    file = folder / "page.py"
    file.write_text(program)
    tools = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    done = subprocess.run(
        [sys.executable, file],
        cwd=folder,
        env=os.environ | {"OMP_NUM_THREADS": "1", "PATH": tools, "CMAKE_GENERATOR": "Ninja"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.integration
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_examples_of_a_page_run(page: Path, tmp_path: Path) -> None:
    program = script(page.read_text(encoding="utf-8"), tmp_path)
    assert program, "no example in this page"
    run(program, tmp_path)


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("page", HOW_TO, ids=lambda page: page.stem)
def test_a_how_to_runs_with_a_trained_run(page: Path, tmp_path: Path) -> None:
    """Beside runs/mine, which is a shipped policy of one robot. What it builds stays in the clone for the next time."""
    text = page.read_text(encoding="utf-8").replace("-S examples/cpp", f"-S {ROOT / 'examples' / 'cpp'}")
    text = text.replace("build/cpp", str(ROOT / "build" / "how-to" / "cpp"))
    program = script(text, tmp_path)
    if not program and 'title="with Gazebo"' in text:
        pytest.skip("Gazebo is not set up; run scripts/gazebo-chroot")
    assert program, "no example in this page"
    shutil.copytree(resolve_policy("diffbot"), tmp_path / "runs" / "mine")
    printed = run(program, tmp_path)
    for promised in re.findall("It prints `(.+)`", text):
        assert promised in printed


@pytest.mark.slow
@pytest.mark.integration
def test_the_commands_example_runs_at_a_smaller_size(tmp_path: Path) -> None:
    program = script((ROOT / "docs" / "commands.md").read_text(encoding="utf-8"), tmp_path)
    for shown, run_here in SMALLER.items():
        assert program.count(shown) == 1, f"docs/commands.md no longer says {shown}"
        program = program.replace(shown, run_here)
    success, low, high = map(float, run(program, tmp_path).split())
    assert low <= success <= high
