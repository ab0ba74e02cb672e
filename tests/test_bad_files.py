"""Bad files and folders on the real command line: exit code 2, one clear message, nothing written."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from adrl.commands.train import _demonstrator
from adrl.errors import CheckpointError
from map_files import write_map
from refusals import Adrl
from small_run import TRAIN, finished_run, run_cli

WALL, FREE = 0, 254


@pytest.fixture
def run(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of a finished run, to be damaged."""
    return shutil.copytree(finished_run(tmp_path_factory), tmp_path / "finished")


def hall() -> np.ndarray:
    """6 m x 6 m at 0.05 m with a wall around and one across from x = 3.0 to 3.2 m, without a door."""
    pixels = np.full((120, 120), FREE, np.uint8)
    pixels[[0, -1], :] = pixels[:, [0, -1]] = WALL
    pixels[:, 60:64] = WALL
    return pixels


class TestPlaces:
    def refused(self, adrl: Adrl, *says: str, option: str = "--map", file: str = "map.yaml") -> None:
        """By all who take a place."""
        for command in (
            ("evaluate", "--policy", "astar-dwa", "--out", "new"),
            ("train", "--steps", "64", "--out", "new"),
            ("collect", "--out", "new"),
        ):
            adrl.refuses(*command, option, file, says=says)

    @pytest.mark.parametrize(
        ("text", "says"),
        [
            (
                "a: &a [x, x]\nb: &b [" + "*a," * 5000 + "]\nc: [" + "*b," * 5000 + "]",
                "values, aliases written out",
            ),
            ("a: " + "[" * 3000 + "]" * 3000, "deep"),
        ],
    )
    def test_map_that_would_fill_memory(self, adrl: Adrl, text: str, says: str) -> None:
        write_map(adrl.folder, hall())
        (adrl.folder / "map.yaml").write_text((adrl.folder / "map.yaml").read_text() + text)
        self.refused(adrl, "map.yaml", says)

    def test_map_that_does_not_exist(self, adrl: Adrl) -> None:
        self.refused(adrl, "map.yaml", "does not exist", "give")

    def test_map_without_its_image(self, adrl: Adrl) -> None:
        write_map(adrl.folder, hall())
        (adrl.folder / "image.pgm").unlink()
        self.refused(adrl, "image.pgm", "does not exist", "YAML")

    def test_map_with_a_truncated_image(self, adrl: Adrl) -> None:
        write_map(adrl.folder, hall())
        image = adrl.folder / "image.pgm"
        image.write_bytes(image.read_bytes()[:200])
        self.refused(adrl, "image.pgm")

    @pytest.mark.parametrize("resolution", [0, -0.05, float("nan")])
    def test_resolution(self, adrl: Adrl, resolution: float) -> None:
        write_map(adrl.folder, hall(), resolution=resolution)
        self.refused(adrl, "map.yaml", "resolution", "give")

    def test_origin_that_is_not_a_number(self, adrl: Adrl) -> None:
        write_map(adrl.folder, hall(), origin=[0.0, float("nan"), 0.0])
        self.refused(adrl, "map.yaml", "origin", "give")

    def test_map_with_no_free_cell(self, adrl: Adrl) -> None:
        write_map(adrl.folder, np.full((40, 40), WALL))
        self.refused(adrl, "map.yaml", "no free cell", "negate")

    def test_map_in_which_the_robot_has_no_room(self, adrl: Adrl) -> None:
        pixels = np.full((40, 40), WALL)
        pixels[:, 18:24] = FREE  # 0.3 m
        write_map(adrl.folder, pixels)
        self.refused(adrl, "map:map", "diffbot", "smaller robot")

    def test_map_in_which_no_robot_has_room(self, adrl: Adrl) -> None:
        """Walls read as free, free space as walls: a smaller robot would not help."""
        write_map(adrl.folder, hall(), negate=1)
        self.refused(adrl, "map:map", "no place has more than", "negate")

    def test_malformed_world(self, adrl: Adrl) -> None:
        (adrl.folder / "bad.world").write_text("<sdf><world><model>")
        self.refused(adrl, "bad.world", option="--world", file="bad.world")

    def test_world_without_geometry(self, adrl: Adrl) -> None:
        (adrl.folder / "empty.world").write_text("<sdf version='1.6'><world name='w'></world></sdf>")
        self.refused(adrl, "empty.world", option="--world", file="empty.world")

    def test_map_and_world_together(self, adrl: Adrl) -> None:
        message = ("map", "world", "give one of")
        adrl.refuses(
            "evaluate", "--policy", "astar-dwa", "--map", "a.yaml", "--world", "b.world", says=message
        )
        adrl.refuses("train", "--steps", 64, "--map", "a.yaml", "--world", "b.world", says=message)


class TestOwnTask:
    @pytest.mark.parametrize(
        ("start", "goal", "says"),
        [
            ((1.0, 1.0, 0.0), (3.1, 3.0), ("goal", "3.1")),
            ((3.1, 3.0, 0.0), (1.0, 1.0), ("start", "3.1")),
            ((1.0, 1.0, 0.0), (5.0, 5.0), ("5.0",)),
            ((1.0, 1.0, 0.0), (50.0, 5.0), ("goal", "50.0")),
            ((-9.0, 1.0, 0.0), (1.0, 5.0), ("start", "-9.0")),
            ((1.0, 1.0, 0.0), (1.1, 1.0), ("goal", "start already")),
            ((1.0, float("nan"), 0.0), (1.0, 5.0), ("nan",)),
            ((1.0, 1.0, float("nan")), (1.0, 5.0), ("nan",)),
            ((1.0, 1.0, 0.0), (float("inf"), 5.0), ("inf",)),
        ],
    )
    def test_the_message_names_the_place(
        self, adrl: Adrl, start: tuple[float, ...], goal: tuple[float, ...], says: tuple[str, ...]
    ) -> None:
        write_map(adrl.folder, hall())
        task = ("--map", "map.yaml", "--start", *start, "--goal", *goal)
        adrl.refuses("evaluate", "--policy", "astar-dwa", "--out", "new", *task, says=says)

    def test_a_good_one_is_driven(self, adrl: Adrl) -> None:
        write_map(adrl.folder, hall())
        task = ("--map", "map.yaml", "--start", 1.0, 1.0, 0.0, "--goal", 1.5, 5.0)
        assert run_cli("evaluate", "--policy", "astar-dwa", "--out", "new", *task) == 0
        assert (adrl.folder / "new" / "summary.json").exists()

    @pytest.mark.parametrize("half", [("--start", 1.0, 1.0, 0.0), ("--goal", 1.0, 5.0)])
    def test_start_and_goal_go_together(self, adrl: Adrl, half: tuple[object, ...]) -> None:
        write_map(adrl.folder, hall())
        says = ("--start and --goal go together",)
        adrl.refuses("evaluate", "--policy", "astar-dwa", "--map", "map.yaml", *half, says=says)

    @pytest.mark.parametrize("idle", [("--episodes", 3), ("--split", "train")])
    def test_they_are_no_task_of_a_split(self, adrl: Adrl, idle: tuple[object, ...]) -> None:
        write_map(adrl.folder, hall())
        task = ("--start", 1.0, 1.0, 0.0, "--goal", 1.0, 5.0)
        adrl.refuses(
            "evaluate", "--policy", "astar-dwa", "--map", "map.yaml", *task, *idle, says=(str(idle[0]),)
        )

    def test_a_scenario_has_no_place_for_them(self, adrl: Adrl) -> None:
        task = ("--start", 1.0, 1.0, 0.0, "--goal", 1.0, 5.0)
        adrl.refuses("evaluate", "--policy", "astar-dwa", *task, says=("--map", "--world", "clutter"))


class TestRobotFiles:
    @pytest.mark.parametrize(
        ("text", "says"),
        [
            ("[lidar]\nnum_beams = 0", ("num_beams is 0", "give 1 to 2048")),
            ("max_speed_mps = nan", ("max_speed_mps", "nan", "give")),
            ("[lidar]\nnoise_std_m = nan", ("noise_std_m", "nan", "give")),
            ("radius_m = 0.0", ("radius_m is 0.0", "give 0.01 to 10")),
            ("max_sped_mps = 1.0", ("max_sped_mps", "'max_speed_mps'")),
            ("name = ", ("not valid TOML",)),
        ],
    )
    def test_bad_values(self, adrl: Adrl, text: str, says: tuple[str, ...]) -> None:
        (adrl.folder / "cart.toml").write_text(text)
        says = ("cart.toml", *says)
        adrl.refuses("evaluate", "--policy", "astar-dwa", "--robot", "cart.toml", says=says)
        adrl.refuses("train", "--steps", 64, "--robot", "cart.toml", "--out", "new", says=says)
        adrl.refuses("collect", "--robot", "cart.toml", "--out", "new", says=says)

    def test_missing_file(self, adrl: Adrl) -> None:
        says = ("cart.toml", "does not exist", "give")
        adrl.refuses("evaluate", "--policy", "astar-dwa", "--robot", "cart.toml", says=says)


def _truncate(run: Path) -> None:
    path = run / "policy.safetensors"
    path.write_bytes(path.read_bytes()[:-100])


def _foreign(run: Path) -> None:
    save_file({"weight": np.zeros((3, 3), np.float32)}, run / "policy.safetensors")


def _text(run: Path) -> None:
    (run / "policy.safetensors").write_text("these are no weights")


def _reshape(run: Path) -> None:
    arrays = load_file(run / "policy.safetensors")
    save_file({name: array[..., :-1].copy() for name, array in arrays.items()}, run / "policy.safetensors")


def _not_finite(run: Path) -> None:
    arrays = load_file(run / "policy.safetensors")
    for array in arrays.values():
        array.flat[0] = np.nan
    save_file(arrays, run / "policy.safetensors")


def _no_weights(run: Path) -> None:
    (run / "policy.safetensors").unlink()


def _garbage(run: Path) -> None:
    (run / "config.json").write_text('{"schema_version": 1, "input')


def _binary(run: Path) -> None:
    (run / "config.json").write_bytes(b"\xff\xfe\x00garbage")


def _other_json(run: Path) -> None:
    (run / "config.json").write_text("[1, 2]")


def _no_beams(run: Path) -> None:
    path = run / "config.json"
    path.write_text(path.read_text().replace('"num_beams": 180', '"num_beams": 0'))


def _unknown_encoder(run: Path) -> None:
    path = run / "config.json"
    path.write_text(path.read_text().replace('"near_m"', '"nearness_m"', 1))


class TestPolicies:
    @pytest.mark.parametrize(
        ("damage", "file"),
        [
            (_truncate, "policy.safetensors"),
            (_foreign, "policy.safetensors"),
            (_text, "policy.safetensors"),
            (_reshape, "policy.safetensors"),
            (_not_finite, "policy.safetensors"),
            (_no_weights, "policy.safetensors"),
            (_garbage, "config.json"),
            (_binary, "config.json"),
            (_other_json, "config.json"),
            (_no_beams, "num_beams"),
            (_unknown_encoder, "nearness_m"),
        ],
    )
    def test_damaged(self, adrl: Adrl, run: Path, damage: Callable[[Path], None], file: str) -> None:
        damage(run)
        adrl.refuses("evaluate", "--policy", run, "--episodes", 2, "--out", "new", says=(file,))

    def test_versions_of_a_trained_run_are_not_needed(self, tmp_path: Path) -> None:
        """What is damaged is named, after the policy is there."""
        path = tmp_path / "versions.json"
        path.write_text('{"planner": 3}')
        with pytest.raises(CheckpointError, match=r"versions\.json .*the policy is trained"):
            _demonstrator(tmp_path)
        path.unlink()
        assert _demonstrator(tmp_path) is None

    def test_missing_folder(self, adrl: Adrl) -> None:
        adrl.refuses("evaluate", "--policy", "runs/gone", says=("runs/gone", "no such folder", "give"))

    def test_folder_of_something_else(self, adrl: Adrl) -> None:
        (adrl.folder / "other").mkdir()
        adrl.refuses("evaluate", "--policy", "other", says=("other", "config.json", "give"))


class TestDatasets:
    @pytest.fixture
    def data(self, tmp_path: Path) -> Path:
        path = tmp_path / "data-v0"
        assert run_cli("collect", "--out", path, "--steps", 256, "--num-envs", 16) == 0
        return path

    def test_of_another_robot_or_encoder(self, adrl: Adrl, data: Path) -> None:
        for option in (("--robot", "jackal"), ("--encoder.num-sectors", 24), ("--guidance", "map")):
            adrl.refuses(*TRAIN, *option, "--dataset", data, "--out", "new", says=("data-v0",))

    def test_damaged(self, adrl: Adrl, data: Path) -> None:
        path = next(data.rglob("*.hdf5"))
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        adrl.refuses(*TRAIN, "--dataset", data, "--out", "new", says=("data-v0", "truncated"))

    def test_missing(self, adrl: Adrl) -> None:
        adrl.refuses(*TRAIN, "--dataset", "gone", "--out", "new", says=("gone", "no such folder", "give"))

    def test_collect_overwrites_nothing(self, adrl: Adrl, data: Path) -> None:
        says = (str(data), "exists already", "give another folder")
        adrl.refuses("collect", "--out", data, "--steps", 256, "--num-envs", 16, says=says)


class TestRunFolders:
    def test_a_finished_run_is_not_overwritten(self, adrl: Adrl, run: Path) -> None:
        adrl.refuses(*TRAIN, "--out", run, says=(str(run), "finished run", "--out", "--resume"))

    def test_an_unfinished_run_is_not_overwritten(self, adrl: Adrl, run: Path) -> None:
        (run / "policy.safetensors").unlink()
        adrl.refuses(*TRAIN, "--out", run, says=(str(run), "unfinished run", "--out", "--resume"))

    @pytest.mark.parametrize(
        ("option", "says"),
        [
            (("--td3.gamma", "0.9"), "gamma"),
            (("--seed", "1"), "seed"),
            (("--td3.widths", "32", "32"), "widths"),
            (("--robot", "jackal"), ""),
            (("--encoder.num-sectors", "24"), ""),
            (("--num-envs", "16"), ""),
            (("--task-pool", "4"), ""),
            (("--scenario", "complex"), ""),
            (("--guidance", "map"), ""),
            (("--demonstration-steps", "1024"), ""),
        ],
    )
    def test_resume_with_other_settings(
        self, adrl: Adrl, run: Path, option: tuple[str, ...], says: str
    ) -> None:
        adrl.refuses(*TRAIN, *option, "--steps", 8192, "--out", run, "--resume", says=(run.name, says))

    def test_damaged_checkpoint(self, adrl: Adrl, run: Path) -> None:
        path = next((run / "checkpoint").rglob("replay.safetensors"))
        path.write_bytes(path.read_bytes()[:1000])
        says = ("replay.safetensors", "truncated")
        adrl.refuses(*TRAIN, "--steps", 8192, "--out", run, "--resume", says=says)
