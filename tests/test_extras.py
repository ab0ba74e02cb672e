"""What the extra train brings is enough to be left out by whoever does not train, and is named to whoever does."""

import re
from importlib.metadata import requires
from pathlib import Path

import pytest

import adrl
from adrl import extras, imitation
from adrl.errors import MissingExtra
from only_packages import COMMAND, modules_of, run_with
from small_run import TRAIN

NAMED = "needs the extra train; run: pip install 'adrl[train]'\n"


def base() -> list[str]:
    """What `pip install adrl` brings."""
    return [need for need in requires("adrl") or [] if "extra ==" not in need]


def test_only_the_extra_brings_what_training_needs() -> None:
    assert not set(extras.MODULES["train"]) & set(modules_of(base()))
    of_extra = [need for need in requires("adrl") or [] if re.search(r"extra == .train\b", need)]
    assert set(extras.MODULES["train"]) <= set(modules_of(of_extra))


@pytest.mark.integration
@pytest.mark.parametrize(
    "command",
    [
        ["list"],
        ["robot", "jackal"],
        ["evaluate", "--policy", "default", "--episodes", "2", "--out", "drives"],
        ["view", "--help"],
    ],
    ids=lambda command: command[0],
)
def test_what_does_not_train_does_without_it(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run_with(base(), COMMAND, command)
    assert done.returncode == 0, done.stderr
    if command[0] == "evaluate":
        assert run_with(base(), COMMAND, ["report", "drives"]).returncode == 0
        assert (tmp_path / "drives" / "report.html").stat().st_size > 1e6


@pytest.mark.integration
@pytest.mark.parametrize(
    "command",
    [
        [*TRAIN, "--out", "out"],
        ["collect", "--scenario", "clutter", "--out", "out"],
        ["compare", "--methods", "td3", "--scenario", "clutter", "--steps", "100", "--out", "out"],
        ["bench", "learn"],
    ],
    ids=lambda command: command[0],
)
def test_what_trains_names_it_before_any_work(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run_with(base(), COMMAND, command)
    assert done.returncode == 2
    assert done.stderr.endswith(NAMED)
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_the_api_names_it_too(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(extras.MODULES, "train", ("no_such_module",))
    with pytest.raises(MissingExtra, match=r"pip install 'adrl\[train\]'"):
        adrl.train(
            adrl.RunConfig(scenario="clutter", learner=adrl.TrainConfig(steps=100), out=tmp_path / "out")
        )
    with pytest.raises(MissingExtra, match=r"pip install 'adrl\[train\]'"):
        imitation.load_minari(tmp_path)
