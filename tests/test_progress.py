"""Progress bars: a live one on a terminal, lines in a file; the last state is told in both."""

import io
import os
import pty
import re
import subprocess
import sys

import pytest
from rich.console import Console

from adrl.commands import progress
from small_run import SIZES, run_cli


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_a_file_gets_a_line_every_some_seconds_and_the_last(
    capsys: pytest.CaptureFixture[str], clock: list[float]
) -> None:
    with progress.progress_bar("work") as show:
        for i in range(10_001):
            clock[0] = 0.01 * i
            show(i / 10_000, f"{i} done")
    text = capsys.readouterr().err
    lines = text.splitlines()
    assert "\r" not in text and "\x1b" not in text  # noqa: PT018
    assert lines[0] == "0:00 work, 0 %"
    assert lines[-1] == "1:40 work, 100 %, 10000 done"
    assert 9 <= len(lines) <= 13


def test_a_new_phase_is_told_at_once_and_once(capsys: pytest.CaptureFixture[str], clock: list[float]) -> None:
    with progress.progress_bar("work") as show:
        for phase in ("probe", "training", "validation", "training", "validation"):
            show(0.5, phase=phase)
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(", ")[1] for line in lines] == ["0 %", "probe", "training", "validation", "validation"]


def test_what_ends_with_an_error_tells_where_it_stood(capsys: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        with progress.counting_bar("work", "parts") as show:
            for i in range(1, 4):
                show(i, 4)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert capsys.readouterr().err.splitlines()[-1].endswith("75 %, 3 of 4 parts")


def test_jobs_are_told_when_one_ends(capsys: pytest.CaptureFixture[str], clock: list[float]) -> None:
    with progress.job_bar("comparing") as show:
        for i in range(301):
            clock[0] = float(i)
            show(i // 100, 2, 3)
    lines = capsys.readouterr().err.splitlines()
    assert {line.split(", ")[1] for line in lines} == {"0 of 3", "1 of 3", "2 of 3", "3 of 3"}
    assert len(lines) <= 40
    assert re.search(r"about \d+ min left|about \d+ s left", lines[15])


def test_the_last_bar_on_a_terminal_is_true(monkeypatch: pytest.MonkeyPatch) -> None:
    """However fast the last states followed each other."""
    screen = io.StringIO()
    monkeypatch.setattr(
        progress, "console", lambda: Console(file=screen, force_terminal=True, width=100, color_system=None)
    )
    with progress.progress_bar("work") as show:
        for i in range(1001):
            show(i / 1000, f"{i} done", "driving")
    last = [line for line in screen.getvalue().splitlines() if "%" in line][-1]
    assert "work: driving" in last
    assert "100%" in last
    assert "1000 done" in last


@pytest.mark.slow
@pytest.mark.integration
def test_training_names_its_phases(tmp_path: object, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_cli("train", *SIZES, "--out", f"{tmp_path}/run") == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if re.match(r"\d+:\d\d ", line)]
    told = [line.split(", ")[1] for line in lines if " %" in line]
    wanted = ["0 %", "worlds", "demonstrations", "probe", "compilation", "training"]
    assert list(dict.fromkeys(told))[:6] == wanted
    last = [line for line in lines if " %" in line][-1]
    assert "training, 100 %, 4096 steps" in last


@pytest.mark.slow
@pytest.mark.integration
def test_training_on_a_terminal_ends_with_a_full_bar(tmp_path: object) -> None:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "adrl.cli", "train", *SIZES, "--out", f"{tmp_path}/run"]
    with subprocess.Popen(
        command,
        stderr=theirs,
        stdout=subprocess.DEVNULL,
        env=os.environ | {"COLUMNS": "200", "TERM": "xterm"},
    ) as process:
        os.close(theirs)
        screen = b""
        while True:
            try:
                part = os.read(ours, 65536)
            except OSError:  # how a terminal ends
                break
            screen += part
        assert process.wait() == 0
    text = screen.decode()
    for phase in ("demonstrations", "compilation", "training"):
        assert f"adrl on clutter: {phase}" in text
    last = [line for line in re.split(r"[\r\n]", text) if "adrl on clutter" in line][-1]
    assert "100%" in last
    assert "4096 steps" in last
