"""Bad options on the real command line: exit code 2, one clear message, nothing written."""

import pytest

from refusals import Adrl
from small_run import TRAIN, run_cli

ENDLESS = TRAIN[:3]
"""Training with neither --steps nor --max-seconds."""


class TestNames:
    @pytest.mark.parametrize(
        ("arguments", "says"),
        [
            (("trian",), ("unknown command 'trian'", "'train'")),
            (("bench", "simm"), ("unknown benchmark 'simm'", "'sim'")),
            (("evaluate", "--policy", "astar-dwa", "--scenario", "cluter"), ("'cluter'", "'clutter'")),
            (("evaluate", "--policy", "astar-dwa", "--robot", "jackl"), ("'jackl'", "'jackal'")),
            (("evaluate", "--policy", "astar-dwa", "--guidance", "gaol"), ("gaol", "goal")),
            (("evaluate", "--policy", "astar-dwa", "--split", "tset"), ("tset", "test")),
            (("train", "--steps", 64, "--scenario", "complx"), ("'complx'", "'complex'")),
            (("train", "--steps", 64, "--robot", "turtlebot3_burgr"), ("'turtlebot3_burger'",)),
            (("train", "--steps", 64, "--method", "adlr"), ("unknown method 'adlr'", "'adrl'")),
            (("train", "--steps", 64, "--guidance", "mapp"), ("unknown guidance 'mapp'", "'map'")),
            (("collect", "--out", "d", "--scenario", "dinamic"), ("'dinamic'", "'dynamic'")),
            (("evaluate", "--episdes", 3), ("--episdes", "--episodes")),
            (("train", "--steps", 64, "--td3.policy-delay", 4), ("--td3.policy-delay",)),
            (("train", "--steps", 64, "--replanner.arrival-m", 0.3), ("--replanner.arrival-m",)),
        ],
    )
    def test_the_nearest_is_suggested(
        self, adrl: Adrl, arguments: tuple[object, ...], says: tuple[str, ...]
    ) -> None:
        adrl.refuses(*arguments, says=says)

    @pytest.mark.parametrize(
        "arguments",
        [
            ("train", "--steps", 64, "--scenario"),
            ("train", "--steps", 64, "--guidance"),
            ("train", "--steps", 64, "--teachers"),
            ("evaluate", "--policy", "astar-dwa", "--scenario"),
            ("compare", "--steps", 64, "--scenario"),
            ("compare", "--steps", 64, "--guidance"),
            ("compare", "--steps", 64, "--eval-guidance"),
            ("compare", "--steps", 64, "--policies"),
            ("compare", "--steps", 64, "--teachers"),
            ("regret", "--quick", "--out", "new", "--cells"),
            ("reproduce", "--quick", "--out", "new", "--places"),
        ],
    )
    def test_a_text_that_names_none_is_refused(self, adrl: Adrl, arguments: tuple[object, ...]) -> None:
        name = str(arguments[-1]).removeprefix("--").replace("-", "_")
        adrl.refuses(*arguments, ",", says=(f"{name} is ','", "give names with commas between"))


class TestNumbers:
    @pytest.mark.parametrize(
        ("options", "says"),
        [
            (("--max-seconds", "nan"), ("max_seconds is nan", "give")),
            (("--max-seconds", "-1"), ("max_seconds is -1", "give")),
            (("--max-seconds", "0"), ("max_seconds is 0", "give")),
            (("--max-seconds", "inf"), ("max_seconds is inf", "give")),
            (("--steps", "0"), ("steps is 0", "give 1 or more")),
            (("--steps", "many"), ("--steps", "many")),
            ((), ("--steps", "--max-seconds")),
            (("--steps", "64", "--seed", "-1"), ("seed is -1", "give 0")),
            (("--steps", "64", "--num-envs", "0"), ("num_envs is 0", "give 1 to 65536")),
            (("--steps", "64", "--task-pool", "0"), ("task_pool is 0", "give 1 to 1e+06")),
            (("--steps", "64", "--demonstration-steps", "0"), ("demonstration_steps is 0", "needs")),
            (("--steps", "64", "--expert", "slow:2"), ("share is 2", "give 0.4 to 1")),
            (("--steps", "64", "--expert", "quick"), ("unknown expert 'quick'", "slow")),
            (("--steps", "64", "--td3.gamma", "nan"), ("gamma is nan", "give")),
            (("--steps", "64", "--td3.actor-learning-rate", "nan"), ("actor_learning_rate is nan", "give")),
            (("--steps", "64", "--exploration-std", "nan", "0.4"), ("exploration_std", "give")),
            (("--steps", "64", "--schedule.k-q", "nan"), ("schedule.k_q is nan", "give")),
            (("--steps", "64", "--reward.scale", "nan"), ("reward.scale is nan", "give")),
            (("--steps", "64", "--encoder.near-m", "nan"), ("encoder.near_m is nan", "give")),
        ],
    )
    def test_train(self, adrl: Adrl, options: tuple[str, ...], says: tuple[str, ...]) -> None:
        adrl.refuses(*ENDLESS, *options, says=says)

    @pytest.mark.parametrize(
        ("arguments", "says"),
        [
            (("evaluate", "--policy", "astar-dwa", "--episodes", "0"), ("episodes is 0", "give 1 or more")),
            (
                ("evaluate", "--policy", "astar-dwa", "--guidance", "goal"),
                ("does not drive with guidance", "map or replan"),
            ),
            (
                ("evaluate", "--policy", "astar-mppi", "--guidance", "goal"),
                ("does not drive with guidance", "map or replan"),
            ),
            (
                ("evaluate", "--policy", "astar-dwa", "--guidance", "replan", "--paper-literal"),
                ("paper_literal", "astar-dwa"),
            ),
            (("evaluate", "--policy", "astar-dwa", "--seed", "-1"), ("seed is -1", "give 0 or more")),
            (("evaluate", "--policy", "astar-dwa", "--threads", "-1"), ("threads is -1", "give 0 or more")),
            (("collect", "--out", "d", "--steps", "0"), ("steps is 0", "give 1 or more")),
            (("collect", "--out", "d", "--seed", "-1"), ("seed is -1", "give 0 or more")),
            (("collect", "--out", "d", "--num-envs", "0"), ("num_envs is 0", "give 1 or more")),
            (("collect",), ("--out",)),
            (("bench", "sim", "--beams", "0"), ("num_beams is 0", "give 1 to 2048")),
            (("bench", "sim", "--envs", "0"), ("envs is 0", "give 1 or more")),
            (("bench", "sim", "--seconds", "nan"), ("seconds is nan", "give a positive number")),
            (("bench", "plan", "--envs", "0"), ("envs is 0", "give 1 or more")),
            (("bench", "plan", "--rounds", "0"), ("rounds is 0", "give 1 or more")),
            (("bench", "learn", "--widths", "0"), ("widths is [0]", "positive widths")),
            (("bench", "learn", "--seconds", "inf"), ("seconds is inf", "give a positive number")),
        ],
    )
    def test_the_others(self, adrl: Adrl, arguments: tuple[str, ...], says: tuple[str, ...]) -> None:
        adrl.refuses(*arguments, says=says)


class TestOutputs:
    def test_a_file_in_the_way(self, adrl: Adrl) -> None:
        (adrl.folder / "file").write_text("precious")
        for out in ("file", "file/below"):
            adrl.refuses(*TRAIN, "--out", out, says=("--out", "file"))
            adrl.refuses(
                "evaluate", "--policy", "astar-dwa", "--episodes", 2, "--out", out, says=("--out", "file")
            )
            adrl.refuses("collect", "--out", out, says=("--out", "file"))
        evaluate = ("evaluate", "--policy", "astar-dwa", "--episodes", 2, "--out", "new")
        adrl.refuses(*evaluate, "--json", "file/below.json", says=("--json", "file"))
        adrl.refuses("bench", "sim", "--json", "file/below.json", says=("--json", "file"))

    def test_a_folder_in_the_way_of_a_file(self, adrl: Adrl) -> None:
        (adrl.folder / "folder").mkdir()
        adrl.refuses(
            "evaluate", "--policy", "astar-dwa", "--out", "new", "--json", "folder", says=("--json", "folder")
        )


@pytest.mark.parametrize("peer", ["gone/python", "/bin/false"])
def test_peer_that_cannot_run(adrl: Adrl, peer: str) -> None:
    sizes = ("--envs", 4, "--beams", 8, "--seconds", 0.01, "--rounds", 1, "--json", "sim.json")
    adrl.refuses("bench", "sim", *sizes, "--peer-python", peer, says=("--peer-python", peer))


def test_a_discount_under_which_crashing_pays_is_refused(capsys):
    assert run_cli("train", "--steps", 64, "--td3.gamma", 0.99) == 2
    assert "failure_weight above 1.65" in capsys.readouterr().err
    assert run_cli("train", "--steps", 64, "--scenario", "clutter", "--map", "x.yaml") == 2
    assert "give one of scenario, map, world and barn" in capsys.readouterr().err
    assert run_cli("train", "--steps", 64, "--method", "td3", "--dataset", "x") == 2
    assert "leave out dataset" in capsys.readouterr().err
    assert run_cli("train", "--steps", 64, "--method", "td3", "--expert", "slow") == 2
    assert "leave out expert" in capsys.readouterr().err
    assert run_cli("train", "--steps", 64, "--dataset", "x", "--expert", "slow") == 2
    assert "leave one out" in capsys.readouterr().err
