"""Where a robot on its way heads for, by each guidance: the goal itself, or a point on a way that it plans to there."""

import contextlib
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adrl.deploy.messages import Pose
from adrl.errors import ConfigError, PlanningError
from adrl.observation.path_ahead import PATH_POINTS_M
from adrl.planning.path_guide import MapGuide
from adrl.planning.replanner import Replanner
from adrl.planning.standstill import Standstill
from adrl.types import Array, RobotConfig, World

F32 = NDArray[np.float32]
Point = tuple[float, float]
ONE = np.array([0])
"""The only robot, where kernels take many."""
RELOCALISED_M = 0.5
"""A pose on the map that jumps by so much more than the robot can drive is a new start for the path."""
HELD_S = 1.0
"""A robot that was not led for longer was held."""
OFF_RAD = 0.1
"""A path on the map ends near enough to a goal that has moved by less, seen from the robot: noise of localisation."""


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """What a robot knows of where it is."""

    ranges: F32
    """(1, K) m, by the LiDAR that the policy knows."""
    reckoned: Array
    """(1, 3) its pose by odometry."""
    place: Pose
    """Its pose in the frame of goals."""
    now_s: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Heading:
    """Where to go next."""

    waypoint: Point
    distance_m: float
    """To the goal."""
    goal: Point
    """Where the goal is taken to be: noise may have moved it into a wall."""
    plan: Array
    """(P, 2) the way that is meant, from the robot on."""
    path: Array | None
    """(Q, 2) points of it, adrl.observation.path_ahead.PATH_POINTS_M ahead: what a policy may be told of it. None of a
    replanner's route, where it does not tell."""


class Guide:
    """Guidance `goal`: straight to it. Goals, waypoints and plans are in the odometry's frame, with a map in its."""

    name = "goal"
    follows_given_path = False
    """Whether the way to the goal is not its own."""

    @property
    def may_arrive(self) -> bool:
        """Whether a robot at its goal has come to the end of its way."""
        return True

    def set_goal(self, path: Array | None = None) -> None:
        """Another goal, which head_for is given from now on. path: (P, 2) to follow there. Raises ConfigError."""
        if path is not None:
            raise ConfigError(f"guidance {self.name} follows no path; leave it out, or give guidance map")

    def move_path(self, path: Array) -> None:
        """The path that is followed is the same, better known."""

    def wait(self) -> None:
        """The robot stands, without a goal."""

    def forget(self) -> None:
        """The odometry's frame is another now."""

    def look(self, view: View, goal: Point) -> None:
        """The robot is held on its way, and sees."""

    def head_for(self, view: View, goal: Point) -> Heading:
        """The next waypoint. Raises PlanningError where a map shows no way."""
        distance_m = math.dist(goal, view.place[:2])
        return Heading(
            waypoint=goal,
            distance_m=distance_m,
            goal=goal,
            plan=np.array([view.place[:2], goal]),
            path=np.tile(goal, (len(PATH_POINTS_M), 1)),
        )

    def as_shown(self, towards: Array) -> Array:
        """(1, 2) a waypoint in the robot's frame -> the same as the policy is shown it."""
        return towards


class OwnMapGuide(Guide):
    """Guidance `replan`: waypoints on the robot's own map once it is stuck."""

    name = "replan"

    def __init__(self, replanner: Replanner) -> None:
        """replanner: of one robot."""
        self.replanner = replanner
        self._is_new = self._under_way = False
        """The goal; whether the robot has driven since it last stood without one."""

    def set_goal(self, path: Array | None = None) -> None:
        """See Guide."""
        super().set_goal(path)
        self._is_new = True

    def wait(self) -> None:
        """See Guide."""
        self._under_way = False

    def forget(self) -> None:
        """See Guide: the map was of the other frame."""
        self._under_way, self._is_new = False, True

    def look(self, view: View, goal: Point) -> None:
        """See Guide: a robot that stands on its way is not blind."""
        self.head_for(view, goal)

    def head_for(self, view: View, goal: Point) -> Heading:
        """See Guide. Enters the scan into the map first."""
        targets = np.array([goal])
        if not self._is_new:
            self.replanner.move_goals(ONE, targets)
        elif self._under_way:
            self.replanner.retarget(ONE, targets)
        else:
            self.replanner.reset(ONE, targets, view.reckoned)
        self._under_way, self._is_new = True, False
        x, y = self.replanner.update(view.ranges, view.reckoned)[0].tolist()
        here = view.place[:2]
        return Heading(
            waypoint=(x, y),
            distance_m=math.dist(goal, here),
            goal=goal,
            plan=np.array([here, goal] if (x, y) == goal else [here, (x, y), goal]),
            path=ahead_of_one(self.replanner),
        )

    def as_shown(self, towards: Array) -> Array:
        """See Guide."""
        return self.replanner.as_goals(towards)


def ahead_of_one(replanner: Replanner) -> Array | None:
    """(P, 2) points of the only robot's way, a copy; None where the replanner does not tell."""
    ahead = replanner.path_ahead
    return None if ahead is None else ahead[0].copy()


class KnownMapGuide(Guide):
    """Guidance `map`: waypoints on a path of the known map."""

    name = "map"

    def __init__(self, world: World, robot: RobotConfig, goal_tolerance_m: float) -> None:
        self._map = MapGuide(world, robot)
        self._robot, self._goal_tolerance_m = robot, goal_tolerance_m
        self._given: Array | None = None
        self._is_new = False
        self._last: tuple[Pose, float] | None = None
        self._standstill = Standstill(1)

    @property
    def follows_given_path(self) -> bool:
        """See Guide."""
        return self._given is not None

    def set_goal(self, path: Array | None = None) -> None:
        """See Guide. ADRL plans a path of its own when None."""
        self._given, self._is_new = path, True

    def head_for(self, view: View, goal: Point) -> Heading:
        """See Guide."""
        before, held = self._map.path, self._held(view)
        goal = self._route(view, goal)
        self._is_new, self._last = False, (view.place, view.now_s)
        waypoint, left_m = self._map.waypoint(view.place)
        anew = held or self._map.path is not before
        stands = not anew and self._stands(view, left_m)
        if stands:
            with contextlib.suppress(PlanningError):  # it goes on with the path it has
                self._map.set_goal(view.place, goal)
            waypoint, left_m = self._map.waypoint(view.place)
        if stands or anew:
            self._standstill.begin(ONE, left_m, view.now_s)
        plan = np.concatenate([[view.place[:2]], self._map.remaining(left_m)])
        return Heading(waypoint=waypoint, distance_m=left_m, goal=goal, plan=plan, path=self._map.path_ahead)

    def _route(self, view: View, goal: Point) -> Point:
        """Have a path to the goal; where it is. Raises PlanningError."""
        if self._is_new and self._given is not None:
            self._map.follow(self._given)
            return goal
        if self._is_new or self._relocalised(view):
            self._map.set_goal(view.place, goal)
            return goal
        x, y = self._map.path[-1].tolist()
        off_m, noise_m = math.dist((x, y), goal), OFF_RAD * math.dist(goal, view.place[:2])
        if self._given is not None or off_m < max(0.5 * self._goal_tolerance_m, noise_m):
            return goal
        try:
            self._map.set_goal(view.place, goal)
        except PlanningError:
            if off_m > RELOCALISED_M + 2.0 * noise_m:
                raise
            return x, y  # noise has moved it into a wall
        return goal

    def _held(self, view: View) -> bool:
        """Whether the robot was not led for a while: it stood for another reason than its path."""
        return self._last is not None and view.now_s - self._last[1] > HELD_S

    def _stands(self, view: View, left_m: float) -> bool:
        """Whether the robot is a car that has not got on for a while on a path of its own: as in NavSim."""
        if self._given is not None or not self._robot.is_car:
            return False
        return bool(self._standstill.update(np.array([left_m]), np.array([view.now_s]))[0])

    def _relocalised(self, view: View) -> bool:
        """Whether localisation has found the robot elsewhere than it can have driven to."""
        if self._last is None:
            return False
        before, at_s = self._last
        moved_m = math.dist(before[:2], view.place[:2])
        return moved_m > drivable_m(self._robot, at_s, view.now_s) + RELOCALISED_M


def drivable_m(robot: RobotConfig, since_s: float, now_s: float) -> float:
    """More than the robot can have driven since then: it may be faster than it is told to be."""
    return 2.0 * robot.max_speed_mps * max(now_s - since_s, robot.control_period_s)


def check_guidance(guidance: str, world: World | None) -> None:
    """Raises ConfigError for guidance `map` without a map, and for another one with."""
    if guidance == "map" and world is None:
        raise ConfigError("guidance map needs a map; give world, or guidance goal or replan")
    if guidance != "map" and world is not None:
        raise ConfigError(f"guidance {guidance} uses no map; leave out world, or give guidance map")
