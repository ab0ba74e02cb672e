"""The benchmark's worlds as they are on disk, and what is made of them."""

import dataclasses
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from adrl import _core
from adrl.errors import ConfigError, NoPath, TaskError, WorldError
from adrl.planning.global_planner import length_m
from adrl.worlds import ROBOTS, BarnScenario, load_barn, task_set
from adrl.worlds.barn import (
    BOUNDS,
    CELL_M,
    CORRIDOR_CELLS,
    FIELD_CELLS,
    GOAL,
    START,
    BarnWorld,
    benchmark_path,
    field_task,
    field_world,
)
from adrl.worlds.place import Place

JACKAL = ROBOTS["jackal"]


@pytest.fixture(scope="module")
def folder(barn: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten of the given worlds: reading all of them takes seconds."""
    folder = tmp_path_factory.mktemp("barn")
    files = sorted((barn / "worlds").glob("*.world"), key=number_of)[::5]
    for file in files:
        shutil.copy(file, folder)
        shutil.copy(barn / "paths" / f"path_{number_of(file)}.npy", folder)
    return folder


@pytest.fixture(scope="module")
def worlds(folder: Path) -> list[BarnWorld]:
    return load_barn(folder)


def number_of(file: Path) -> int:
    return int(file.stem.removeprefix("world_"))


def cells_of(world: BarnWorld) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of each cylinder."""
    column, row = np.rint((world.world.circles[:, :2] - BOUNDS[:2]) / CELL_M - 0.5).astype(int).T
    return row, column


def test_worlds_come_in_the_order_of_their_numbers(folder: Path, worlds: list[BarnWorld]) -> None:
    assert [world.number for world in worlds] == sorted(map(number_of, folder.glob("*.world")))


def test_cylinders_stand_on_the_grid_and_around_the_corridor(worlds: list[BarnWorld]) -> None:
    for world in worlds:
        circles = world.world.circles
        np.testing.assert_allclose(circles[:, 2], 0.5 * CELL_M)
        row, column = cells_of(world)
        centres = np.column_stack([column, row]) * CELL_M + 0.5 * CELL_M + BOUNDS[:2]
        np.testing.assert_allclose(circles[:, :2], centres, atol=1e-9)
        assert row.max() == CORRIDOR_CELLS + FIELD_CELLS - 1
        # Walls at both sides all along; in the corridor nothing else but its closed end.
        for side in (0, FIELD_CELLS - 1):
            assert set(row[column == side]) >= set(range(CORRIDOR_CELLS))
        assert set(column[row == 0]) == set(range(FIELD_CELLS))
        assert set(column[(row > 0) & (row < CORRIDOR_CELLS)]) == {0, FIELD_CELLS - 1}


def test_paths_and_cylinders_line_up(worlds: list[BarnWorld]) -> None:
    """The benchmark keeps 5 x 5 cells free: 0.375 m from the middle of the path's cell to a cylinder. Its own metres
    are 0.18 m off, and still pass through no cylinder.
    """
    for world in worlds:
        for points, least_m in ((world.path, 0.19), (np.add(world.path[1:-1], (0.15, 0.1)), 0.374)):
            poses = np.column_stack([points, np.zeros(len(points))])
            clearance = _core.clearance(world.world.native, poses, 0.0, np.empty((0, 2)), 1.0)
            assert clearance.min() >= least_m


def test_a_path_in_metres() -> None:
    path = benchmark_path(np.array([(0.0, 0.0), (10.0, 20.0)]))
    np.testing.assert_allclose(path, [START[:2], (-4.575, 5.075), (-3.075, 8.075), GOAL])


def test_the_optimal_time_is_the_path_at_two_metres_a_second(worlds: list[BarnWorld]) -> None:
    for world in worlds:
        assert world.optimal_time_s == pytest.approx(0.5 * length_m(world.path))
        assert 5.0 <= world.optimal_time_s <= 8.0  # 10 m in a straight line


def test_our_fields_rebuild_theirs(worlds: list[BarnWorld]) -> None:
    """Cylinder for cylinder, corridor included. Where an inner one was left out, ours leaves it out too."""
    for world in worlds:
        row, column = cells_of(world)
        filled = np.zeros((FIELD_CELLS, FIELD_CELLS), dtype=bool)
        inside = row >= CORRIDOR_CELLS
        filled[row[inside] - CORRIDOR_CELLS, column[inside]] = True
        ours = field_world(filled).circles
        theirs = world.world.circles
        assert {tuple(c) for c in ours.round(6)} == {tuple(c) for c in theirs.round(6)}


def test_hidden_cylinders_are_left_out() -> None:
    filled = np.zeros((FIELD_CELLS, FIELD_CELLS), dtype=bool)
    empty = len(field_world(filled).circles)
    filled[10:13, 10:13] = True
    assert len(field_world(filled).circles) - empty == 8
    filled[:] = False
    filled[:3, :3] = True  # at the field's edge something may look in
    assert len(field_world(filled).circles) - empty == 9 - 1


def test_every_world_is_solvable_for_a_jackal_that_turns_on_the_spot(worlds: list[BarnWorld]) -> None:
    for world in worlds:
        task = field_task(world.world, JACKAL)
        assert task.start == START == (-2.0, 3.0, 0.5 * math.pi)
        assert task.goal == GOAL == (-2.0, 13.0)
        assert task.goal_tolerance_m == 1.0
        pieces = [np.linspace(a, b, 200) for a, b in zip(task.path[:-1], task.path[1:], strict=True)]
        points = np.concatenate(pieces)
        poses = np.column_stack([points, np.zeros(len(points))])
        radius = JACKAL.circumscribed_radius_m
        assert _core.clearance(world.world.native, poses, radius, np.empty((0, 2)), 1.0).min() > 0.0
        # Ours is taut, theirs runs on cells and bends to start and goal.
        assert 10.0 <= task.shortest_m <= world.path_m + 0.4


def test_a_wall_across_the_field_is_no_way_through() -> None:
    filled = np.zeros((FIELD_CELLS, FIELD_CELLS), dtype=bool)
    filled[15] = True
    with pytest.raises(NoPath):
        field_task(field_world(filled), JACKAL)


def test_a_split_holds_out_whole_worlds(folder: Path) -> None:
    scenario = BarnScenario(folder, held_out=3)
    train = {world.number for world in scenario.split("train")}
    held_out = {world.number for world in scenario.split("validation")}
    assert (len(train), len(held_out)) == (7, 3)
    assert not train & held_out
    assert held_out == {world.number for world in scenario.split("test")}
    everything = BarnScenario(folder)
    assert len({task.shortest_m for task in task_set(everything, JACKAL, "train", 30)}) > 5
    tasks = task_set(scenario, JACKAL, "train", 14)
    assert all(a is b for a, b in zip(tasks[:7], tasks[7:], strict=True))
    assert task_set(scenario, JACKAL, "train", 3, first=2) == tasks[2:5]
    with pytest.raises(ConfigError, match="give 0 to 9"):
        BarnScenario(folder, held_out=10)


def test_a_place_takes_a_folder(folder: Path) -> None:
    assert isinstance(Place(barn=folder, barn_held_out=2).load(), BarnScenario)
    with pytest.raises(ConfigError, match="one of scenario, map, world and barn"):
        Place(barn=folder, scenario="clutter")
    with pytest.raises(ConfigError, match="without barn"):
        Place(barn_held_out=2)


def test_paths_are_found_beside_and_one_level_up(folder: Path, tmp_path: Path) -> None:
    world = next(folder.glob("*.world"))
    path = folder / f"path_{number_of(world)}.npy"
    for worlds, paths in (("worlds", "paths"), ("BARN", "BARN/path_files"), (".", ".")):
        place = tmp_path / worlds.replace(".", "flat")
        beside = tmp_path / paths.replace(".", "flat")
        place.mkdir(parents=True, exist_ok=True)
        beside.mkdir(parents=True, exist_ok=True)
        shutil.copy(world, place)
        shutil.copy(path, beside)
        assert len(load_barn(tmp_path if worlds == "worlds" else place)) == 1


def test_any_number_of_zeros_and_the_benchmarks_own_folders(folder: Path, tmp_path: Path) -> None:
    world = next(folder.glob("*.world"))
    number = number_of(world)
    for name in ("world_files", "path_files"):
        (tmp_path / name).mkdir()
    shutil.copy(world, tmp_path / "world_files" / f"world_{number:04d}.world")
    shutil.copy(folder / f"path_{number}.npy", tmp_path / "path_files" / f"path_{number:03d}.npy")
    (tmp_path / "world_files" / "world_old.world").write_text("no world of the benchmark")
    assert [world.number for world in load_barn(tmp_path)] == [number]
    shutil.copy(world, tmp_path / "world_files")
    with pytest.raises(WorldError, match="one number"):
        load_barn(tmp_path)


def test_a_damaged_path_is_a_world_error_whatever_is_damaged(folder: Path, tmp_path: Path) -> None:
    world = next(folder.glob("*.world"))
    shutil.copy(world, tmp_path)
    whole = (folder / f"path_{number_of(world)}.npy").read_bytes()
    file = tmp_path / f"path_{number_of(world)}.npy"
    header_open = whole.replace(b"}", b"(", 1)
    for damaged in (header_open, whole[:40], whole[:-3], b"PK\x03\x04 no archive", b""):
        file.write_bytes(damaged)
        with pytest.raises(WorldError, match=file.name):
            load_barn(tmp_path)


@pytest.mark.parametrize("content", ["missing", "text", "flat", "nan", "empty", "metres"])
def test_a_bad_path_is_named(folder: Path, tmp_path: Path, content: str) -> None:
    world = next(folder.glob("*.world"))
    shutil.copy(world, tmp_path)
    file = tmp_path / f"path_{number_of(world)}.npy"
    if content == "text":
        file.write_text("not numpy")
    elif content != "missing":
        arrays = {"flat": np.arange(4), "nan": np.array([(np.nan, 1.0)]), "empty": np.empty((0, 2))}
        arrays["metres"] = np.array([(-2.0, 5.0)])
        np.save(file, arrays[content])
    with pytest.raises(WorldError, match=file.name):
        load_barn(tmp_path)


def test_a_folder_without_worlds_is_named(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match=r"no world_N\.world"):
        load_barn(tmp_path)


def test_a_robot_too_large_is_told_which_world(folder: Path) -> None:
    giant = dataclasses.replace(JACKAL, name="giant", footprint_m=None, radius_m=1.0)
    with pytest.raises(TaskError, match="world"):
        task_set(BarnScenario(folder), giant, "train", 1)
