"""People in any scenario: who they are, where they stand at first, and where they walk to and fro."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from adrl.errors import ConfigError, TaskError
from adrl.planning.global_planner import grid_path, shorten
from adrl.planning.grid import clearance_limit_m, free_space, inflation_m, planning_grid
from adrl.types import MOST_PEOPLE, SPLITS, Array, People, RobotConfig, Scenario, Task, World
from adrl.worlds.tasks import TaskSpace, task_set, task_space

Range = tuple[float, float]
APART_M = 0.1
"""Between bodies at the start."""
GROUP_M = 1.2
"""Farthest that one of a group starts from the first."""
TRIES = 400


@dataclass(frozen=True, kw_only=True)
class Crowd:
    """Who walks."""

    count: tuple[int, int] = (6, 12)
    """Fewest and most people."""
    share: float = 0.5
    """Of what is to be done to avoid the robot, the part that people do who look: 0 leaves all to the robot, 0.5 is
    reciprocal, 1 leaves nothing to it."""
    legs: bool = False
    """A LiDAR sees two legs of 0.1 m that swing, not bodies."""
    radius_m: Range = (0.2, 0.3)
    """Of a body."""
    speed_mps: Range = (0.5, 1.6)
    """Preferred; a group has one."""
    reaction_s: Range = (0.1, 0.4)
    """Time between two decisions of a person."""
    standing: float = 0.1
    """Part of the people who stand."""
    heedless: float = 0.05
    """Part of the people who do not look: they do nothing to avoid the robot."""
    grouped: float = 0.3
    """Part of those who walk that set out in groups of two or three."""
    start_distance_m: float = 1.5
    """Least distance at time 0 from the robot's centre to a body."""

    def __post_init__(self) -> None:
        low, high = self.count
        if not 1 <= low <= high <= MOST_PEOPLE:
            raise ConfigError(f"people: {low} to {high}; give 1 to {MOST_PEOPLE}")
        for name in ("share", "standing", "heedless", "grouped"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ConfigError(f"people's {name} is {getattr(self, name)}; give 0 to 1")


class Ground:
    """Where people may walk in a world: the cells with room for the largest of them."""

    def __init__(self, world: World, robot: RobotConfig, radius_m: float) -> None:
        """robot: shares the grid."""
        limit_m = max(clearance_limit_m(robot), inflation_m(radius_m, 0.25) + 0.05)
        space = free_space(planning_grid(world, limit_m), robot, radius_m)
        self.tasks: TaskSpace = task_space(space)
        self.bounds = world.bounds

    def draw(self, rng: np.random.Generator) -> Array:
        """(2,) any place. Raises TaskError where there is none."""
        if len(self.tasks.cells) == 0:
            raise TaskError("no place has room for a person; take another world")
        width = self.tasks.regions.shape[1]
        index = int(self.tasks.cells[rng.integers(len(self.tasks.cells))])
        return self.tasks.space.grid.centre((index // width, index % width))

    def is_free(self, point: Array) -> bool:
        """Whether a person may stand at (x, y)."""
        grid = self.tasks.space.grid
        row, column = grid.cell(point)
        return bool(grid.contains(point)) and self.tasks.space.blocked[row, column] == 0

    def sees(self, a: Array, b: Array) -> bool:
        """Whether one can walk straight from a to b."""
        count = math.ceil(math.dist(a, b) / self.tasks.space.grid.resolution_m) + 1
        return all(self.is_free(a + share * (b - a)) for share in np.linspace(0.0, 1.0, count))

    def route(self, a: Array, b: Array) -> Array | None:
        """(W, 2) shortest way from a to b, None where there is none."""
        grid, regions = self.tasks.space.grid, self.tasks.regions
        if not (self.is_free(a) and self.is_free(b)):
            return None
        first, last = (tuple(int(k) for k in grid.cell(point)) for point in (a, b))
        if regions[first] != regions[last] or first == last:
            return None
        corners = shorten(self.tasks.space, grid_path(self.tasks.space, first, last))  # pyright: ignore
        return np.array([a, *corners[1:-1], b])


Walks = Callable[[np.random.Generator, Ground], Iterator[Array | None]]
"""Draws routes (W, 2) without end, None where a try came to nothing."""


def anywhere(rng: np.random.Generator, ground: Ground, start: Array | None = None) -> Iterator[Array | None]:
    """From any place, or the one given, to any other, 3 m off or, in a small world, a third of its extent."""
    least_m = min(3.0, float(ground.tasks.extents_m.max(initial=0.0)) / 3.0)
    while True:
        a, b = ground.draw(rng) if start is None else start, ground.draw(rng)
        yield ground.route(a, b) if math.dist(a, b) >= least_m else None


class Peopled:
    """A scenario among people. Its worlds, starts and goals are those of `place`, task by task."""

    def __init__(
        self, place: Scenario, crowd: Crowd | None = None, walks: Walks = anywhere, *, name: str | None = None
    ) -> None:
        """name: place's with what is asked for by default."""
        self.place, self.crowd, self.walks = place, crowd or Crowd(), walks
        self.name = name or place.name
        self._ground: tuple[World, float, Ground] | None = None

    def among(self, count: int | None, share: float | None, legs: bool) -> "Peopled":
        """The same with so many people, such a share, with legs; None and False: as it is. Its name tells."""
        low, high = (count, count) if count else self.crowd.count
        crowd = replace(
            self.crowd,
            count=(low, high),
            share=self.crowd.share if share is None else share,
            legs=legs or self.crowd.legs,
        )
        told = [f"{count}people"] if count else []
        told += [f"share{share:g}"] if share is not None else []
        told += ["legs"] if legs else []
        return Peopled(self.place, crowd, self.walks, name="-".join([self.name, *told]))

    @property
    def training_worlds(self) -> Sequence[World]:
        """Of the place, where they are given: see adrl.worlds.given."""
        return getattr(self.place, "training_worlds", ())

    @property
    def notes(self) -> tuple[str, ...]:
        """What is to be known of how the place was read."""
        return tuple(getattr(self.place, "notes", ()))

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a task of the place and people for it. Raises TaskError."""
        return self._populated(self.place.task(rng, robot), rng, robot)

    def numbered_task(self, split: str, index: int, robot: RobotConfig) -> Task:
        """Task `index` of a split of the place, with people of its own. Raises TaskError."""
        (task,) = task_set(self.place, robot, split, 1, index)
        return self.with_people(task, robot, split, index)

    def with_people(self, task: Task, robot: RobotConfig, split: str = "test", index: int = 0) -> Task:
        """Any task of the place with the people of task `index` of a split. Raises TaskError."""
        # Of the place's name alone: with another share or with legs the same people walk the same routes.
        entropy = crc32(f"people:{self.place.name}".encode())
        rng = np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(SPLITS.index(split), index)))
        return self._populated(task, rng, robot)

    def _populated(self, task: Task, rng: np.random.Generator, robot: RobotConfig) -> Task:
        radius_m = self.crowd.radius_m[1]
        if self._ground is None or self._ground[0] is not task.world or self._ground[1] != radius_m:
            self._ground = task.world, radius_m, Ground(task.world, robot, radius_m)
        try:
            people = draw_people(rng, self.crowd, self._ground[2], self.walks, task.start)
        except TaskError as error:
            raise TaskError(f"scenario {self.name!r}: {error}") from None
        return replace(task, people=people)


def draw_people(
    rng: np.random.Generator,
    crowd: Crowd,
    ground: Ground,
    walks: Walks,
    start: tuple[float, float, float],
) -> People:
    """People of a crowd on the ground, none touching another or near the robot's start. Raises TaskError."""
    count = int(rng.integers(crowd.count[0], crowd.count[1] + 1))
    routes = walks(rng, ground)
    placed = _Placed(crowd, ground, start)
    for _ in range(TRIES):
        if len(placed.routes) == count:
            return placed.people()
        route = next(routes)
        if route is not None:
            placed.add_group(rng, route, count - len(placed.routes))
    raise TaskError(
        f"{len(placed.routes)} of {count} people found room; ask for fewer, or take a larger world"
    )


class _Placed:
    """People that have found their places."""

    def __init__(self, crowd: Crowd, ground: Ground, start: tuple[float, float, float]) -> None:
        self.routes: list[Array] = []
        self._crowd, self._ground, self._start = crowd, ground, np.array(start[:2])
        self._rows: list[tuple[float, float, float, float, int]] = []
        self._groups = 0

    def add_group(self, rng: np.random.Generator, route: Array, most: int) -> None:
        """One person, or two or three together, at most so many; those that find no room stay away."""
        crowd = self._crowd
        stands = rng.random() < crowd.standing
        # A group is of 2.5 in the mean: the chance that those who set out next are one, for the part of people.
        in_groups = crowd.grouped / (2.5 - 1.5 * crowd.grouped)
        size = int(rng.integers(2, 4)) if not stands and rng.random() < in_groups else 1
        speed = 0.0 if stands else float(rng.uniform(*crowd.speed_mps))
        group = self._groups if min(size, most) > 1 else -1
        for member in range(min(size, most)):
            radius, heedless = float(rng.uniform(*crowd.radius_m)), rng.random() < crowd.heedless
            reaction = float(rng.uniform(*crowd.reaction_s))
            place = route[0] if member == 0 else self._beside(rng, route[0], radius)
            if place is None or not self._has_room(place, radius):
                if member == 0:
                    return
                continue
            straight = member == 0 or self._ground.sees(place, route[1])
            self.routes.append(route[:1] if stands else np.array([place, *route[straight:]]))
            self._rows.append((radius, speed, 0.0 if heedless else crowd.share, reaction, group))
        self._groups += group >= 0

    def people(self) -> People:
        radius, speed, share, reaction, group = (np.array(column) for column in zip(*self._rows, strict=True))
        return People(
            routes=tuple(self.routes),
            radius_m=radius,
            speed_mps=speed,
            share=share,
            reaction_s=reaction,
            group=group.astype(np.int32),
            legs=self._crowd.legs,
        )

    def _beside(self, rng: np.random.Generator, first: Array, radius: float) -> Array | None:
        for _ in range(20):
            place = first + rng.uniform(-GROUP_M, GROUP_M, 2)
            if self._has_room(place, radius) and self._ground.sees(first, place):
                return place
        return None

    def _has_room(self, place: Array, radius: float) -> bool:
        if math.dist(place, self._start) < self._crowd.start_distance_m + radius or not self._ground.is_free(
            place
        ):
            return False
        return all(
            math.dist(place, route[0]) >= radius + row[0] + APART_M
            for route, row in zip(self.routes, self._rows, strict=True)
        )


def one_more(people: People, place: Array, ground: Ground, rng: np.random.Generator) -> People:
    """These people and one more, who walks to and fro between a place (2,) and another. Raises TaskError."""
    crowd = Crowd(legs=people.legs)
    routes = anywhere(rng, ground, place)
    route = next((way for _, way in zip(range(TRIES), routes, strict=False) if way is not None), None)
    if route is None:
        x, y = place
        raise TaskError(f"no person can walk from ({x:.2f}, {y:.2f}); take a place with more room")
    drawn = {name: rng.uniform(*getattr(crowd, name)) for name in ("radius_m", "speed_mps", "reaction_s")} | {
        "share": crowd.share,
        "group": -1,
    }
    added = {name: np.append(getattr(people, name), value) for name, value in drawn.items()}
    blind = None if people.blind is None else np.append(people.blind, False)
    return replace(people, routes=(*people.routes, route), blind=blind, **added)


def among_people(scenario: Scenario, count: int, share: float | None, legs: bool) -> Scenario:
    """The scenario with so many people, who take such a share and have legs to a LiDAR; unchanged where none is asked.

    Raises ConfigError for a share or legs without people.
    """
    if count == 0 and share is None and not legs:
        return scenario
    if isinstance(scenario, Peopled):
        return scenario.among(count or None, share, legs)
    if count == 0:
        raise ConfigError(f"nobody walks in {scenario.name!r}; give --people too")
    return Peopled(scenario).among(count, share, legs)
