"""cellular: fields of cylinders made as the BARN benchmark makes its own, without any of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adrl.errors import NoPath, TaskError
from adrl.types import RobotConfig, Task, World
from adrl.worlds.barn import CELL_M, FIELD_CELLS, field_task, field_world, path_clearance_m

BATCH = 32
"""Fields drawn at once: most dense ones have no way through."""
BATCHES = 100
"""Batches tried with one fill and number of steps,"""
DENSITIES = 20
"""and how many of those are tried: robots wider than the benchmark's get sparser fields."""
FIELDS = 20
"""Fields that a car tries; other robots have a task in the first."""

Fields = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Cellular:
    """A random field of cylinders that a cellular automaton smooths; start and goal are those of the BARN benchmark."""

    name: str = "cellular"
    fill: tuple[float, float] = (0.15, 0.3)
    """Least and greatest share of cells filled at random; the benchmark has 0.15, 0.2, 0.25 and 0.3."""
    smoothings: tuple[int, int] = (2, 4)
    """Fewest and most steps of the automaton."""

    def generate(self, rng: np.random.Generator, robot: RobotConfig) -> World:
        """Draw a field with a way through for this robot. Raises TaskError for one too large."""
        margin = margin_cells(robot)
        for _ in range(DENSITIES if 2 * margin < FIELD_CELLS - 2 else 0):
            fill = rng.uniform(*self.fill)
            steps = int(rng.integers(self.smoothings[0], self.smoothings[1] + 1))
            field = _draw_open(rng, fill, steps, margin)
            if field is not None:
                return field_world(field)
        raise TaskError(
            f"scenario {self.name!r}: no field has a way through for robot {robot.name!r}, which needs "
            f"{2 * margin + 1} free cells of {CELL_M} m abreast; take a smaller robot or less fill"
        )

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a field and its task: the next field where a car finds no curves. Raises TaskError for a robot too large
        for it."""
        reason = ""
        for _ in range(FIELDS):
            try:
                return field_task(self.generate(rng, robot), robot)
            except NoPath as error:  # there is a way, but none that this car can steer
                if not robot.is_car:
                    raise
                reason = str(error)
        raise TaskError(f"scenario {self.name!r}: none of {FIELDS} fields had a task: {reason}")


def _draw_open(rng: np.random.Generator, fill: float, steps: int, margin: int) -> Fields | None:
    """(rows, columns) a field with a way through, or None when none of many has one."""
    for _ in range(BATCHES):
        fields = rng.random((BATCH, FIELD_CELLS, FIELD_CELLS)) < fill
        fields[..., [0, -1]] = True
        for _ in range(steps):
            fields = smooth(fields)
        open_ones = np.flatnonzero(have_way_through(fields, margin))
        if len(open_ones):
            return fields[open_ones[0]]
    return None


def smooth(fields: Fields) -> Fields:
    """One step of the automaton on fields (..., rows, columns).

    A cell with five or more filled neighbours of eight is filled, with one or none it is emptied, and else it stays.
    Beyond the left and right edge all is filled, beyond the other two nothing.
    """
    rows, columns = fields.shape[-2:]
    around = np.zeros((*fields.shape[:-2], rows + 2, columns + 2), dtype=np.int8)
    around[..., [0, -1]] = 1
    around[..., 1:-1, 1:-1] = fields
    in_row = around[..., :-2] + around[..., 1:-1] + around[..., 2:]
    in_block = in_row[..., :-2, :] + in_row[..., 1:-1, :] + in_row[..., 2:, :]
    # The block counts the cell itself too.
    return np.where(fields, in_block >= 3, in_block >= 5)


def margin_cells(robot: RobotConfig) -> int:
    """Free cells that the robot needs on every side of the one its centre is in: two for a Jackal."""
    needed_m = robot.circumscribed_radius_m + path_clearance_m()
    return max(0, int(np.ceil((needed_m + 0.5 * CELL_M) / CELL_M - 1e-9)) - 1)


def have_way_through(fields: Fields, margin: int) -> NDArray[np.bool_]:
    """(B, rows, columns) -> (B,) whether a way leads from the first row to the last.

    It is of cells, side by side, with so many free ones on every side. Beyond the first and the last row all is free,
    as the benchmark has it.
    """
    # SciPy's import takes 0.4 s, and a list of scenarios should not.
    from scipy import ndimage

    window = np.ones((1, 2 * margin + 1, 2 * margin + 1), dtype=bool)
    free = ~np.asarray(ndimage.binary_dilation(fields, structure=window), dtype=np.bool_)
    one_by_one = np.zeros((3, 3, 3), dtype=bool)
    one_by_one[1] = ndimage.generate_binary_structure(2, 1)
    labels = np.empty(fields.shape, dtype=np.int32)
    ndimage.label(free, structure=one_by_one, output=labels)
    # Labels are unlike from field to field, so those of all last rows can be looked up at once.
    arrived = np.isin(labels[:, 0], labels[:, -1][labels[:, -1] > 0])
    return np.logical_or.reduce(arrived, axis=1)
