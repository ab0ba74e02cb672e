"""Guidance along the path of another planner, with nothing else known: what stands in its way the robot maps itself."""

import itertools
import math

import numpy as np

from adrl.deploy.guidance import ONE, Guide, Heading, Point, View, ahead_of_one
from adrl.errors import ConfigError
from adrl.observation.path_ahead import PATH_POINTS_M
from adrl.planning.path_guide import LOOKAHEAD_M
from adrl.planning.replanner import THROUGH_WHAT_MAY_GO, Replanner
from adrl.types import Array

PARTS = (1.0, 0.75, 0.55, 0.4, 0.3, 0.2)
"""Of the look-ahead: waypoints that are tried in turn, as in training with guidance `map`."""
BLIND_PART = 0.15
"""Of the look-ahead, where the robot sees a free way to none of them."""
WINDOW_M = 2.0 * LOOKAHEAD_M
"""The robot is looked for so far ahead of where it was on the path, and its way is checked so far ahead."""
BACK_M = 1.0
"""It is looked for so far back as well: help may have taken it there."""
STEP_M = 0.3
"""Pieces of the path that are checked one by one."""
REJOIN_M = 6.0
"""What blocks the path is driven round to a point of it no farther ahead than this. Else another path is needed."""
DETOUR_M, DETOUR = 2.0, 2.0
"""The way round may be so many times as long as the piece of the path that it takes the place of, and so much longer.
Beyond that another path is needed."""
AT_CUSP_M = 0.05
"""A car so near to a place of the path where it turns back has come to it."""
NEARLY_M = 1.0
"""With so much of the path left the robot may arrive: a path may pass its own end before."""


class GivenPathGuide(Guide):
    """Guidance `path`: the path leads, in the odometry's frame. The way round what blocks it is planned on the robot's
    own map. A car is led to no point beyond the next place where the path turns back before it has come there."""

    name = "path"

    def __init__(self, replanner: Replanner, *, car: bool = False) -> None:
        """replanner: of one robot. car: whether that cannot turn on the spot."""
        self.replanner = replanner
        self._car = car
        self._cusps_m: Array = np.empty(0)
        """Lengths of the path to where a car turns back."""
        self._path: Array = np.empty((0, 2))
        self._lengths_m: Array = np.empty(0)
        """(P,) from the path's begin to each of its points."""
        self._along_m = 0.0
        self._left_m = math.inf
        self._maps = False
        """Whether there is a map of where the robot is."""
        self._round = False
        """Whether it is on its way round what blocks the path."""

    @property
    def follows_given_path(self) -> bool:
        """See Guide."""
        return True

    @property
    def may_arrive(self) -> bool:
        """See Guide."""
        return self._left_m < NEARLY_M

    def set_goal(self, path: Array | None = None) -> None:
        """See Guide. What is mapped stays."""
        if path is None:
            raise ConfigError("guidance path follows a path; give one, or another guidance")
        self._along_m, self._round = 0.0, False
        self.move_path(path)
        self._left_m = float(self._lengths_m[-1])

    def move_path(self, path: Array) -> None:
        """The same path, better known, as localisation tells."""
        self._path = np.asarray(path, dtype=np.float64)
        steps = np.hypot(*np.diff(self._path, axis=0).T)
        self._lengths_m = np.concatenate([[0.0], np.cumsum(steps)])
        legs = np.diff(self._path[np.concatenate([[True], steps > 0.0])], axis=0)
        corners_m = np.cumsum(np.hypot(*legs.T))[:-1]
        self._cusps_m = corners_m[(legs[1:] * legs[:-1]).sum(axis=1) < 0.0] if self._car else np.empty(0)

    def forget(self) -> None:
        """See Guide: the map was of the other frame."""
        self._maps = self._round = False

    def look(self, view: View, goal: Point) -> None:
        """See Guide: a robot that stands on its way is not blind."""
        self.head_for(view, goal)

    def head_for(self, view: View, goal: Point) -> Heading:
        """See Guide. Enters the scan into the map."""
        here = view.reckoned[0, :2]
        self._advance(here)
        target, blocked_m = self._target(here)
        blocked = blocked_m > 0.0
        goals = np.array([target])
        if not self._maps:
            self.replanner.reset(ONE, goals, view.reckoned)
        elif blocked and self._round:
            self.replanner.move_goals(ONE, goals)
        else:
            self.replanner.retarget(ONE, goals)
        self._maps, self._round = True, blocked
        waypoint = self.replanner.update(view.ranges, view.reckoned)[0]
        on_own_route = bool(self.replanner.following[0])
        told = ahead_of_one(self.replanner) if on_own_route else self._at(self._along_m + PATH_POINTS_M)
        most_m = DETOUR * blocked_m + DETOUR_M
        goes_round = on_own_route and self.replanner.b["found"][0] != THROUGH_WHAT_MAY_GO
        if blocked and not (goes_round and self.replanner.b["route"][0] <= most_m):
            # No way round is known: up to it, and wait.
            waypoint = self._at(np.array([self._along_m + BLIND_PART * LOOKAHEAD_M]))[0]
            told = np.tile(waypoint, (len(PATH_POINTS_M), 1))
        ahead = self._path[self._lengths_m > self._along_m]
        x, y = waypoint.tolist()
        return Heading(
            waypoint=(x, y),
            distance_m=self._left_m,
            goal=goal,
            plan=np.vstack([here, *([waypoint] if blocked else []), ahead]),
            path=told,
        )

    def as_shown(self, towards: Array) -> Array:
        """See Guide."""
        return self.replanner.as_goals(towards) if self.replanner.following[0] else towards

    def _advance(self, here: Array) -> None:
        """Find the robot on the path; a car on its way to the next cusp."""
        last_m = max(self._cusps_m[self._cusps_m <= self._along_m], default=-math.inf)
        least_m, most_m = max(self._along_m - BACK_M, last_m), min(self._along_m + WINDOW_M, self._led_to_m)
        self._along_m, off_m = _nearest(self._path, self._lengths_m, here, least_m, most_m)
        if self._led_to_m - self._along_m < AT_CUSP_M:
            self._along_m = self._led_to_m
        self._left_m = float(self._lengths_m[-1]) - self._along_m + off_m

    def _target(self, here: Array) -> tuple[Array, float]:
        """Where to head for: the farthest point ahead with a free straight way to it, and 0; where the path is blocked,
        the first one beyond that, and how far along the path it is."""
        begin, end = self._along_m, float(self._lengths_m[-1])
        marks = np.minimum(begin + STEP_M * np.arange(1, 1 + round(REJOIN_M / STEP_M)), end)
        points = np.vstack([here, self._at(marks)])
        free = [self._sees(a, b) for a, b in itertools.pairwise(points)]
        near = round(WINDOW_M / STEP_M)
        if False in free[:near]:
            first = free.index(False)
            beyond = next((k for k in range(first + 1, len(free)) if free[k] and free[k - 1]), None)
            if beyond is not None:
                return points[beyond + 1], (beyond + 1) * STEP_M
        ahead = np.minimum(begin + LOOKAHEAD_M * np.array([*PARTS, BLIND_PART]), self._led_to_m)
        *targets, nearest = self._at(ahead)
        return next((target for target in targets if self._sees(here, target)), nearest), 0.0

    @property
    def _led_to_m(self) -> float:
        """Along the path, for a car: the next place where it turns back; infinite where there is none."""
        return float(min(self._cusps_m[self._cusps_m > self._along_m], default=math.inf))

    def _at(self, along_m: Array) -> Array:
        """(M, 2) the points so far (M,) along the path."""
        return np.stack([np.interp(along_m, self._lengths_m, axis) for axis in self._path.T], axis=1)

    def _sees(self, start: Array, end: Array) -> bool:
        """Whether nothing is known on the straight way from one point to another."""
        return not self._maps or self.replanner.sees(start, end)


def _nearest(
    path: Array, lengths_m: Array, here: Array, least_m: float, most_m: float
) -> tuple[float, float]:
    """How far along the path, within bounds, the point nearest to here is; and how far off that is."""
    begins, steps = lengths_m[:-1], np.diff(lengths_m)
    if not steps.any():
        return 0.0, math.dist(path[0], here)
    ways = np.diff(path, axis=0)
    share = ((here - path[:-1]) * ways).sum(axis=1) / np.maximum(steps**2, 1e-12)
    low = np.clip((least_m - begins) / np.maximum(steps, 1e-12), 0.0, 1.0)
    high = np.clip((most_m - begins) / np.maximum(steps, 1e-12), 0.0, 1.0)
    share = np.clip(share, low, high)
    off_m = np.hypot(*(path[:-1] + share[:, None] * ways - here).T)
    off_m[(begins > most_m) | (begins + steps < least_m)] = np.inf
    best = int(off_m.argmin())
    return float(begins[best] + share[best] * steps[best]), float(off_m[best])
