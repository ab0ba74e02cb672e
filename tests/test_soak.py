"""The short form of what docs/reliability.md counts: scripts/soak, as anyone runs it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts" / "soak"

pytestmark = [pytest.mark.slow, pytest.mark.integration]


def test_nothing_goes_wrong_where_everything_does(tmp_path: Path) -> None:
    # The memory that is measured is the script's, however much who starts it has.
    large = bytearray(2**30)
    large[::4096] = b"\1" * len(large[::4096])
    counts = ("--inputs", "50", "--drives", "2", "--kills", "1", "--writes", "1")
    done = subprocess.run(
        [sys.executable, SCRIPT, *counts, "--json", tmp_path / "soak.json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    results = json.loads((tmp_path / "soak.json").read_text())["results"]
    assert list(results) == ["inputs", "drives", "kills", "writes"]
    assert not any(result["wrong"] for result in results.values())
    assert results["inputs"]["refused"] > 0
