"""barn: the worlds of the BARN navigation benchmark, and the field that all of them share.

Cylinders of 0.075 m radius stand on a grid of 0.15 m. A corridor of 34 rows leads into a field of 30 x 30 cells,
walled left and right and open at its end; the goal lies in the open beyond it.
"""

import dataclasses
import math
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError, PlanningError, TaskError, UnknownName, WorldError
from adrl.planning.global_planner import length_m, plan
from adrl.planning.grid import MARGIN_M, RESOLUTION_M, clearance_limit_m, free_space, planning_grid
from adrl.types import SPLITS, Array, RobotConfig, Task, World
from adrl.worlds.sdf import load_sdf
from adrl.worlds.tasks import time_limit_s

CELL_M = 0.15
"""Side of a cell, the diameter of a cylinder."""
FIELD_CELLS = 30
"""Cells on a side of the field."""
CORRIDOR_CELLS = 34
"""Rows of the corridor that leads into it, the one that closes it included."""
BOUNDS = (-4.5, 0.0, 0.0, 14.1)
"""What paths are planned on, m: corridor, field and the open end with the goal; whole cells."""
START = (-2.0, 3.0, 0.5 * math.pi)
GOAL = (-2.0, 13.0)
GOAL_TOLERANCE_M = 1.0
"""An episode has succeeded within this distance of the goal."""
TIME_LIMIT_S = 100.0
"""After which the benchmark stops a run."""
OPTIMAL_SPEED_MPS = 2.0
"""Speed at which the benchmark's path is driven in the optimal time."""
WORLD_FOLDERS = ("worlds", "world_files")
PATH_FOLDERS = ("paths", "path_files")


@dataclass(frozen=True, eq=False, kw_only=True)
class BarnWorld:
    """One world of the benchmark."""

    number: int
    """N of world_N.world."""
    world: World
    path: Array
    """(P, 2) the benchmark's own path, from start to goal; it sets the optimal time and nothing else."""
    file: Path | None = None
    """world_N.world; None for a world that is in no file."""

    @property
    def path_m(self) -> float:
        """Length of that path."""
        return length_m(self.path)

    @property
    def optimal_time_s(self) -> float:
        """OT of the benchmark's score."""
        return self.path_m / OPTIMAL_SPEED_MPS


def load_barn(folder: str | os.PathLike[str]) -> list[BarnWorld]:
    """The worlds of a folder in the order of their numbers.

    world_N.world stand in it or in its subfolder worlds or world_files; path_N.npy beside them or in a folder paths or
    path_files there or one level up. N may have leading zeros. Raises WorldError, which names what is missing or
    malformed.
    """
    folder = Path(folder)
    place = next((folder / name for name in WORLD_FOLDERS if (folder / name).is_dir()), folder)
    worlds = _numbered([place], "world", ".world")
    if not worlds:
        raise WorldError(f"folder {folder} holds no world_N.world; give the folder of the benchmark's worlds")
    places = [place, *(parent / name for parent in (place, place.parent) for name in PATH_FOLDERS)]
    paths = _numbered(places, "path", ".npy")
    for number in sorted(worlds.keys() - paths.keys()):
        looked = ", ".join(str(place) for place in places)
        raise WorldError(
            f"world {worlds[number]} has no path_{number}.npy, which its score needs; looked in {looked}"
        )
    return [
        BarnWorld(
            number=number,
            world=dataclasses.replace(load_sdf(worlds[number]), bounds=BOUNDS),
            path=benchmark_path(_cells(paths[number])),
            file=worlds[number],
        )
        for number in sorted(worlds)
    ]


def _numbered(places: list[Path], stem: str, suffix: str) -> dict[int, Path]:
    """Number -> file stem_N.suffix in the first place that has it. Raises WorldError for two of one number in it."""
    found: dict[int, Path] = {}
    for place in places:
        here: dict[int, Path] = {}
        for path in sorted(place.glob(f"{stem}_*{suffix}")):
            digits = path.stem.removeprefix(f"{stem}_")
            if not (digits.isascii() and digits.isdigit()):
                continue
            if int(digits) in here:
                raise WorldError(f"{here[int(digits)]} and {path} have one number; keep one of them")
            here[int(digits)] = path
        found = here | found
    return found


def _cells(file: Path) -> Array:
    """(P, 2) column, row of the cells in a path file. Raises WorldError."""
    try:
        cells = np.load(file, allow_pickle=False)
    except Exception as error:  # What a damaged header or archive makes numpy raise is not documented.
        raise WorldError(f"path {file} cannot be read: {error}; give the benchmark's path_N.npy") from None
    fits = isinstance(cells, np.ndarray) and cells.ndim == 2 and cells.shape[1:] == (2,) and len(cells) > 0
    if not fits or cells.dtype.kind not in "iuf" or not ((cells >= 0) & (cells < FIELD_CELLS)).all():
        raise WorldError(
            f"path {file} is not an array (P, 2) of cells, columns and rows of 0 to {FIELD_CELLS - 1}; give the "
            "benchmark's path_N.npy"
        )
    return cells.astype(np.float64)


def benchmark_path(cells: Array) -> Array:
    """(P, 2) column, row -> (P + 2, 2) x, y with start and goal, as the benchmark measures its paths.

    Its points lie 0.15 m left of the cells' true middles and 0.10 m before them. The score needs the path's length,
    to which that adds where it bends to start and goal, so it stays as the benchmark has it.
    """
    points = cells * CELL_M + (-4.575, 5.075)
    return np.concatenate([[START[:2]], points, [GOAL]])


def field_world(filled: NDArray[np.bool_]) -> World:
    """A world with cylinders on the filled cells (FIELD_CELLS rows from the corridor on, FIELD_CELLS columns).

    Cylinders with all eight neighbours filled are left out, as the benchmark does: nothing sees or touches them.
    """
    around = np.pad(filled, 1)
    rows, columns = filled.shape
    shifts = [(i, j) for i in range(3) for j in range(3)]
    hidden = np.logical_and.reduce([around[i : i + rows, j : j + columns] for i, j in shifts])
    corridor = np.zeros((CORRIDOR_CELLS, FIELD_CELLS), dtype=bool)
    corridor[:, [0, -1]] = corridor[0] = True
    row, column = np.nonzero(np.concatenate([corridor, filled & ~hidden]))
    radius = 0.5 * CELL_M
    x, y = BOUNDS[0] + column * CELL_M + radius, BOUNDS[1] + row * CELL_M + radius
    return World(bounds=BOUNDS, circles=np.column_stack([x, y, np.full(len(x), radius)]))


def field_task(world: World, robot: RobotConfig) -> Task:
    """The benchmark's start and goal in a world, with the shortest path for the robot's circumscribed disc.

    The benchmark keeps a square of 5 x 5 cells free all along its paths, 0.375 m from their middle: 4 cm more than a
    Jackal needs to turn on the spot, and less than other scenarios' margin; hence path_clearance_m(). Raises
    PlanningError.
    """
    grid = planning_grid(world, clearance_limit_m(robot))
    space = free_space(grid, robot, robot.circumscribed_radius_m - (MARGIN_M - path_clearance_m()))
    path = plan(world, START, GOAL, robot, space)
    shortest_m = length_m(path)
    return Task(
        world=world,
        start=START,
        goal=GOAL,
        path=path,
        shortest_m=shortest_m,
        time_limit_s=time_limit_s(shortest_m, robot),
        goal_tolerance_m=GOAL_TOLERANCE_M,
    )


def path_clearance_m() -> float:
    """Clearance of paths beyond the robot's disc: the least with which straight lines on planning cells are free."""
    return 0.75 * RESOLUTION_M


class BarnScenario:
    """The worlds of a folder, each with the benchmark's start and goal.

    held_out: so many, evenly spread in the order of their numbers, are the validation and test tasks, and the others
    those of training. 0: all are in every split.
    """

    def __init__(self, folder: str | os.PathLike[str], held_out: int = 0) -> None:
        self.worlds = load_barn(folder)
        self.name = f"barn:{Path(folder).resolve().name}"
        count = len(self.worlds)
        if not 0 <= held_out < count:
            raise ConfigError(f"{held_out} worlds held out of the {count} in {folder}; give 0 to {count - 1}")
        self.held_out = held_out
        self._tasks: dict[tuple[int, RobotConfig], Task] = {}

    def split(self, split: str) -> list[BarnWorld]:
        """The worlds of a split. Raises UnknownName."""
        if split not in SPLITS:
            raise UnknownName("split", split, SPLITS)
        return self._parts[split != "train"] if self.held_out else self.worlds

    @property
    def training_worlds(self) -> list[World]:
        """Those of split train."""
        return [world.world for world in self.split("train")]

    @cached_property
    def _parts(self) -> tuple[list[BarnWorld], list[BarnWorld]]:
        count = len(self.worlds)
        chosen = {int((i + 0.5) * count / self.held_out) for i in range(self.held_out)}
        rest = [world for i, world in enumerate(self.worlds) if i not in chosen]
        return rest, [self.worlds[i] for i in sorted(chosen)]

    def numbered_task(self, split: str, index: int, robot: RobotConfig) -> Task:
        """Task `index` of a split: its worlds in turn."""
        worlds = self.split(split)
        return self.task_in(worlds[index % len(worlds)], robot)

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """The task of a training world drawn at random."""
        return self.numbered_task("train", int(rng.integers(len(self.split("train")))), robot)

    def task_in(self, world: BarnWorld, robot: RobotConfig) -> Task:
        """A world's task. Raises TaskError for a robot too large for it."""
        key = world.number, robot
        if key not in self._tasks:
            try:
                self._tasks[key] = field_task(world.world, robot)
            except PlanningError as error:
                raise TaskError(f"{self.name}, world {world.number}: {error}") from None
        return self._tasks[key]
