"""What one evaluation measured, episode by episode, and the field's metrics of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass, fields
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from adrl.errors import CheckpointError

if TYPE_CHECKING:
    import pyarrow as pa

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Each array of more than one column, and the names of its columns in a table.
_WIDE = {
    "start_xy_m": ("start_x_m", "start_y_m"),
    "goal_xy_m": ("goal_x_m", "goal_y_m"),
    "final_pose": ("final_x_m", "final_y_m", "final_yaw_rad"),
}
_DTYPES = {"task": np.int32} | dict.fromkeys(("success", "collision", "timeout", "at_fault"), np.bool_)
_NOT_NEGATIVE = ("distance_m", "time_s", "shortest_m", "smoothness", "near_person_s", "frozen_s")
_AMONG_PEOPLE = ("at_fault", "person_distance_m", "near_person_s", "frozen_s", "lost_s")


@dataclass(frozen=True, eq=False, kw_only=True)
class Episodes:
    """E finished episodes of one policy; arrays are copied, read-only. ValueError on a broken record."""

    task: NDArray[np.int32]
    """(E,) index of the task in its split."""
    success: Flags
    """(E,) reached the goal. Exactly one of success, collision and timeout holds in every episode."""
    collision: Flags
    """(E,) touched an obstacle."""
    timeout: Flags
    """(E,) ran out of time."""
    distance_m: Array
    """(E,) length of the path driven."""
    time_s: Array
    """(E,) simulated time from start to end."""
    shortest_m: Array
    """(E,) length of the shortest feasible path of the inflated footprint into the goal's disc, where episodes end."""
    least_clearance_m: Array
    """(E,) smallest distance between footprint and obstacle on the way, at most 1 m; 0 or less after a collision."""
    mean_speed_mps: Array
    """(E,) distance_m / time_s."""
    smoothness: Array
    """(E,) mean absolute yaw acceleration in rad/s^2: the total variation of the yaw rate per second."""
    start_xy_m: Array
    """(E, 2) where the robot started."""
    goal_xy_m: Array
    """(E, 2) where it had to go."""
    final_pose: Array
    """(E, 3) x, y, yaw at the end."""
    at_fault: Flags | None = None
    """(E,) collided by moving into what it touched; see docs/decisions.md. This and what follows is None where nobody
    walked."""
    person_distance_m: Array | None = None
    """(E,) least distance from the footprint to a person's body, at most 10 m; 0 or less after a touch."""
    near_person_s: Array | None = None
    """(E,) time within 0.5 m of a person."""
    frozen_s: Array | None = None
    """(E,) time at rest: neither driving nor turning."""
    lost_s: Array | None = None
    """(E,) time beyond that of the clear path: of shortest_m at the robot's greatest speed."""

    def __post_init__(self) -> None:
        count = np.asarray(self.task).shape[:1]
        known = {name for name in _AMONG_PEOPLE if getattr(self, name) is not None}
        if known and known != set(_AMONG_PEOPLE):
            raise ValueError(f"episodes among people have all of {', '.join(_AMONG_PEOPLE)}")
        for field in self._fields():
            array = np.array(getattr(self, field.name), dtype=_DTYPES.get(field.name, np.float64))
            shape = (*count, len(_WIDE[field.name])) if field.name in _WIDE else count
            if not count or array.shape != shape:
                raise ValueError(f"episodes.{field.name} has shape {array.shape}; expected {shape or '(E,)'}")
            if not np.isfinite(array).all():
                raise ValueError(f"episodes.{field.name} holds a number that is not finite")
            if field.name in _NOT_NEGATIVE and (array < 0.0).any():
                raise ValueError(f"episodes.{field.name} holds a negative number")
            array.setflags(write=False)
            object.__setattr__(self, field.name, array)
        endings = self.success.astype(int) + self.collision + self.timeout
        if self.at_fault is not None and (self.at_fault & ~self.collision).any():
            raise ValueError("an episode is at fault without a collision")
        if (endings != 1).any():
            first = int(np.flatnonzero(endings != 1)[0])
            raise ValueError(f"episode {first} has {endings[first]} endings; expected exactly one")

    def __len__(self) -> int:
        return len(self.task)

    def select(self, rows: NDArray[np.integer] | Flags) -> Self:
        """The episodes at these row numbers, or where this mask (E,) is true."""
        return type(self)(**{field.name: getattr(self, field.name)[rows] for field in self._fields()})

    @property
    def among_people(self) -> bool:
        """Whether people walked."""
        return self.at_fault is not None

    def _fields(self) -> "list[Field[Any]]":
        """Those that hold arrays."""
        return [field for field in fields(self) if getattr(self, field.name) is not None]

    @classmethod
    def concatenated(cls, parts: Sequence[Self]) -> Self:
        """One part after the other. What people had of the robots is told where they walked in all parts."""
        names = [f.name for f in fields(cls) if all(getattr(part, f.name) is not None for part in parts)]
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})

    def to_table(self) -> "pa.Table":
        """One row an episode; positions become columns such as start_x_m."""
        import pyarrow as pa

        columns: dict[str, NDArray[np.generic]] = {}
        for field in self._fields():
            array = getattr(self, field.name)
            if field.name in _WIDE:
                columns |= {name: array[:, i] for i, name in enumerate(_WIDE[field.name])}
            else:
                columns[field.name] = array
        return pa.table({name: pa.array(column) for name, column in columns.items()})

    @classmethod
    def from_table(cls, table: "pa.Table") -> Self:
        """Inverse of to_table; ignores unknown columns. Raises CheckpointError on a foreign table."""

        def column(name: str, kind: type[np.generic]) -> NDArray[np.generic]:
            if table.column_names.count(name) != 1:
                raise CheckpointError(
                    f"episode table has no column {name!r}, or several; adrl evaluate did not write it"
                )
            values = table.column(name)
            if values.null_count:
                raise CheckpointError(f"episode table has empty values in column {name!r}; evaluate again")
            array = values.to_numpy()
            if not (
                np.can_cast(array.dtype, kind, "same_kind")
                and np.array_equal(array, array.astype(kind), equal_nan=True)
            ):
                raise CheckpointError(
                    f"episode table has values of type {values.type} in column {name!r}, and they are no "
                    f"{kind.__name__}; evaluate again"
                )
            return array

        arrays: dict[str, NDArray[np.generic]] = {}
        for field in fields(cls):
            if field.name in _AMONG_PEOPLE and field.name not in table.column_names:
                continue
            wide = _WIDE.get(field.name)
            kind = _DTYPES.get(field.name, np.float64)
            columns = [column(name, kind) for name in wide or (field.name,)]
            arrays[field.name] = np.stack(columns, axis=1) if wide else columns[0]
        try:
            return cls(**arrays)  # pyright: ignore[reportArgumentType]  # dtypes are set in __post_init__
        except (ValueError, TypeError) as error:
            raise CheckpointError(f"episode table is malformed: {error}") from error


def optimality_ratios(episodes: Episodes) -> Array:
    """(successes,) path driven / shortest path. Left out: a start at the goal, where there is no ratio.

    Below 1 where the robot cuts a corner closer than the planner's margin.
    """
    rows = episodes.success & (episodes.shortest_m > 0.0)
    return episodes.distance_m[rows] / episodes.shortest_m[rows]


def path_weighted_successes(episodes: Episodes) -> Array:
    """(E,) terms of SPL (Anderson et al. 2018): success * shortest / max(driven, shortest), in [0, 1]."""
    longest = np.maximum(episodes.distance_m, episodes.shortest_m)
    ratio = np.divide(episodes.shortest_m, longest, out=np.ones_like(longest), where=longest > 0.0)
    return np.where(episodes.success, ratio, 0.0)


SAMPLES: dict[str, Callable[[Episodes], Array]] = {
    "distance_m": lambda episodes: episodes.distance_m[episodes.success],
    "time_s": lambda episodes: episodes.time_s[episodes.success],
    "optimality": optimality_ratios,
    "spl": path_weighted_successes,
    "least_clearance_m": lambda episodes: episodes.least_clearance_m,
    "smoothness": lambda episodes: episodes.smoothness,
}
"""Metrics that are means: name -> the numbers to average, of successes (OVER_SUCCESSES) or of all."""

SOCIAL_SAMPLES: dict[str, Callable[[Episodes], Array]] = {
    "person_distance_m": lambda episodes: _among(episodes.person_distance_m),
    "near_person_s": lambda episodes: _among(episodes.near_person_s),
    "frozen_s": lambda episodes: _among(episodes.frozen_s),
    "lost_s": lambda episodes: _among(episodes.lost_s)[episodes.success],
}
"""The same among people."""

SOCIAL = ("at_fault", *SOCIAL_SAMPLES)
"""What a summary tells beside the other metrics where people walked."""

RATES = ("success", "collision", "timeout")
"""Endings: metrics that are fractions of the episodes."""

OVER_SUCCESSES = ("distance_m", "time_s", "optimality")
"""Metrics that exist only where the goal was reached; among people `lost_s` too."""

COMMON = (
    "common_tasks",
    *(f"{whose}{name}_common" for name in OVER_SUCCESSES for whose in ("", "reference_")),
)
"""Keys of means_on_common_tasks."""


def samples_of(*several: Episodes) -> dict[str, Callable[[Episodes], Array]]:
    """SAMPLES, and where people walked in all of these SOCIAL_SAMPLES."""
    return SAMPLES | (SOCIAL_SAMPLES if all(episodes.among_people for episodes in several) else {})


def rates_of(*several: Episodes) -> tuple[str, ...]:
    """RATES, and where people walked in all of these `at_fault`, which is a part of collision."""
    return (*RATES, "at_fault") if all(episodes.among_people for episodes in several) else RATES


def success_rate(episodes: Episodes) -> float:
    """Fraction of the episodes that reached the goal. NaN for no episodes."""
    return _mean(episodes.success)


def on_common_tasks(several: Sequence[Episodes]) -> list[Episodes]:
    """The episodes of each policy on the tasks that all of them drove, in the order of the task index.

    Raises ValueError when a policy drove one task more than once: pairing is then not defined.
    """
    for episodes in several:
        if len(np.unique(episodes.task)) != len(episodes):
            raise ValueError("a task was driven more than once by one policy; give one episode a task")
    common = several[0].task
    for episodes in several[1:]:
        common = np.intersect1d(common, episodes.task)
    by_task = [episodes.select(np.argsort(episodes.task)) for episodes in several]
    return [episodes.select(np.isin(episodes.task, common)) for episodes in by_task]


def solved_by_all(several: Sequence[Episodes]) -> list[Episodes]:
    """The episodes of each policy on the tasks that all of them solved: fair ground for Av.D and Av.T."""
    paired = on_common_tasks(several)
    solved = np.logical_and.reduce([episodes.success for episodes in paired])
    return [episodes.select(solved) for episodes in paired]


def means_on_common_tasks(
    policy: Mapping[str, NDArray[Any]], reference: Mapping[str, NDArray[Any]]
) -> dict[str, float]:
    """Av.D, Av.T and optimality of a policy and of a reference over the tasks that both solved.

    policy, reference: columns task, success, distance_m, time_s and shortest_m of their episodes, one a task. Each of
    OVER_SUCCESSES comes as NAME_common and reference_NAME_common, NaN without such a task; common_tasks: how many.
    """
    solved = [np.flatnonzero(columns["success"]) for columns in (policy, reference)]
    tasks, first, second = np.intersect1d(
        policy["task"][solved[0]], reference["task"][solved[1]], return_indices=True
    )
    means: dict[str, float] = {"common_tasks": len(tasks)}
    for prefix, columns, rows in (
        ("", policy, solved[0][first]),
        ("reference_", reference, solved[1][second]),
    ):
        distance, shortest = columns["distance_m"][rows], columns["shortest_m"][rows]
        away = shortest > 0.0  # as optimality_ratios
        means[f"{prefix}distance_m_common"] = _mean(distance)
        means[f"{prefix}time_s_common"] = _mean(columns["time_s"][rows])
        means[f"{prefix}optimality_common"] = _mean(distance[away] / shortest[away])
    return means


def _among(column: Array | None) -> Array:
    assert column is not None, "nobody walked"
    return column


def _mean(samples: Array | Flags) -> float:
    return float(np.mean(samples)) if len(samples) else float("nan")
