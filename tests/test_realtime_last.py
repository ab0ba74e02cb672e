"""On several cores tests of real time run after all others, alone; one run tells of all."""

import json
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
HOOKS = "from realtime_last import pytest_collection_finish, pytest_xdist_make_scheduler"
MODULE = """
import json, os, time
from pathlib import Path
import pytest

def take(name, seconds):
    begin = time.monotonic()
    time.sleep(seconds)
    row = {"name": name, "begin": begin, "end": time.monotonic(), "pid": os.getpid()}
    Path(f"{name}.json").write_text(json.dumps(row))

@pytest.mark.realtime
@pytest.mark.parametrize("number", range(3))
def test_timed(number):
    take(f"timed-{number}", 0.01)
    assert number != int(os.environ["FAILING"])

@pytest.mark.parametrize("number", range(ORDINARY))
def test_ordinary(number):
    take(f"ordinary-{number}", 0.3 if number in (0, ORDINARY - 1) else 0.01)
    assert number != int(os.environ["FAILING"])
"""


def run(
    folder: Path, *options: str, ordinary: int = 12, failing: int = -1
) -> subprocess.CompletedProcess[str]:
    (folder / "conftest.py").write_text(HOOKS)
    (folder / "pytest.ini").write_text("[pytest]\nmarkers = realtime: tells time\n")
    (folder / "test_both.py").write_text(MODULE.replace("ORDINARY", str(ordinary)))
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "xdist",
        "-n",
        "2",
        "--dist",
        "worksteal",
        *options,
    ]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    path = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment |= {"PYTHONPATH": path, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "FAILING": str(failing)}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120)


def rows(folder: Path, kind: str) -> list[dict[str, float]]:
    found = [json.loads(path.read_text()) for path in folder.glob(f"{kind}-*.json")]
    return sorted(found, key=lambda row: row["begin"])


@pytest.mark.parametrize("ordinary", [1, 12])
def test_they_wait_for_all_others_and_for_each_other(tmp_path: Path, ordinary: int) -> None:
    done = run(tmp_path, ordinary=ordinary)
    assert done.returncode == 0, done.stdout
    assert f"{ordinary + 3} passed" in done.stdout.splitlines()[-1]
    others, timed = rows(tmp_path, "ordinary"), rows(tmp_path, "timed")
    assert len({row["pid"] for row in others}) == min(ordinary, 2)
    assert max(row["end"] for row in others) <= timed[0]["begin"]
    assert all(one["end"] <= following["begin"] for one, following in pairwise(timed))


def test_a_failure_of_either_kind_fails_the_run_under_its_own_name_and_stops_nothing(tmp_path: Path) -> None:
    done = run(tmp_path, failing=1)
    assert done.returncode == 1
    for kind in ("timed", "ordinary"):
        assert f"FAILED test_both.py::test_{kind}[1] " in done.stdout
    assert "2 failed, 13 passed" in done.stdout.splitlines()[-1]


def test_a_choice_without_the_others_runs_them_and_one_of_nothing_says_so(tmp_path: Path) -> None:
    done = run(tmp_path, "-k", "timed")
    assert done.returncode == 0
    assert "3 passed" in done.stdout.splitlines()[-1]
    assert run(tmp_path, "-k", "nothing").returncode == pytest.ExitCode.NO_TESTS_COLLECTED
