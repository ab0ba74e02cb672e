"""adrl view does what each of its options says, or refuses it."""

import shutil
from pathlib import Path

import pytest

from adrl.commands.view import ViewOptions, _show
from adrl.deploy.policy import resolve_policy
from adrl.view.drive import Drive
from refusals import Adrl

OF_DRIVES = (
    *(
        ("--scenario", "crowd"),
        ("--policy", "jackal"),
        ("--guidance", "goal"),
        ("--task", "3"),
        ("--out", "d"),
    ),
    *(("--people", "3"), ("--map", "map.yaml")),
)
OF_BAGS = (("--scan-topic", "s"), ("--odometry-topic", "o"), ("--command-topic", "c"))


@pytest.mark.parametrize(
    ("shown", "idle"),
    [
        *((("--ros2",), idle) for idle in (*OF_DRIVES, *OF_BAGS, ("--follow",))),
        *((("--bag", "none.bag"), idle) for idle in OF_DRIVES),
        *(((), idle) for idle in OF_BAGS),
        (("runs/mine", "--follow"), ("--policy", "default")),
    ],
)
def test_no_option_is_passed_over(adrl: Adrl, shown: tuple[str, ...], idle: tuple[str, ...]) -> None:
    adrl.refuses("view", *shown, *idle, says=(idle[0],))


def test_a_run_drives_beside_another_policy_and_among_the_people_asked_for(tmp_path: Path) -> None:
    run = shutil.copytree(resolve_policy("diffbot"), tmp_path / "run")
    show = _show(ViewOptions(run=run, policy=("default",), people=3))
    assert isinstance(show, Drive)
    assert show.choice.policies == (str(run), "default")
    assert show.choice.people == 3
