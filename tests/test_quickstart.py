"""The quickstart: a parameter file of Nav2 and a map, and two commands to a drive with intervals."""

import re
from pathlib import Path

import pytest

import nav2_files
from adrl.worlds import ROBOTS, load_robot
from small_run import run_cli

PAGE = Path(__file__).resolve().parents[1] / "docs" / "quickstart.md"


@pytest.mark.integration
def test_two_commands_lead_from_a_parameter_file_and_a_map_to_intervals(
    tmp_path: Path, maps: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    nav2_files.write(Path("nav2_params.yaml"), nav2_files.parameters(ROBOTS["turtlebot3_waffle"]))
    given = re.findall(r"--set (\S+=\S+)", PAGE.read_text(encoding="utf-8").partition("It printed")[0])
    assert len(given) == 7
    said = [word for setting in given for word in ("--set", setting)]
    assert run_cli("robot", "--from-nav2", "nav2_params.yaml", "-o", "my.toml", *said) == 0
    told = capsys.readouterr().err
    assert load_robot("my.toml").max_speed_mps == ROBOTS["turtlebot3_waffle"].max_speed_mps
    assert "family any" in told
    command = re.search("how well it is driven on your map: adrl (.*)", told)
    assert command is not None
    words = command[1].replace("MAP.yaml", str(maps / "depot" / "depot.yaml")).split()
    assert words[:5] == ["evaluate", "--policy", "default", "--robot", "my.toml"]
    assert run_cli(*words, "--episodes", "4") == 0
    told = capsys.readouterr().err
    counts = re.search(r"of 4 drives (\d) arrived, (\d) touched something, (\d) ran out of time", told)
    assert counts is not None
    assert sum(map(int, counts.groups())) == 4
    assert re.search(r"[\d.]+ to [\d.]+ % arrive \(95 % confidence\)", told)
