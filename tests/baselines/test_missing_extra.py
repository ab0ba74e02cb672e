"""Without Stable-Baselines3 the command says what to install, before any work."""

import importlib.util
from pathlib import Path

import pytest

from adrl.baselines import SB3_METHODS, require_sb3
from adrl.errors import MissingExtra
from small_run import run_cli


@pytest.mark.parametrize("absent", ["torch", "stable_baselines3"])
def test_it_says_what_to_install(
    absent: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == absent else real(name, *a)
    )
    with pytest.raises(MissingExtra, match=r"pip install 'adrl\[baselines\]'"):
        require_sb3()
    for method in SB3_METHODS:
        assert run_cli("compare", "--methods", method, "--steps", 100, "--out", tmp_path / "out") == 2
        assert "adrl[baselines]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
