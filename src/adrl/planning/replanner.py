"""Adaptive replanning, section III-C: from the robot's own scans and odometry to the point it should head for.

A robot follows the final goal until eq 18 finds it stagnant or, in the corrected form, it knows of an obstacle on the
straight way there. Then it plans on what it has mapped itself (eq 22), heads for waypoints of the route (eqs 21 and
23), plans anew as it sees more, and is handed back to the goal when it has seen all of the way between them to be free.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.observation import footprint_extent
from adrl.observation.path_ahead import PATH_POINTS_M
from adrl.planning.global_planner import inscribed_radius_m
from adrl.planning.path_guide import LOOKAHEAD_M
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import Array, Form, RobotConfig, RobotRows

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]
Rows = slice | NDArray[np.intp]

LEAST_STEPS = 2
"""Control periods between two plans: in tight places waypoints are near, and every step would ask for one."""
NO_ROUTE, THROUGH_WHAT_MAY_GO = 0, 3
"""Of the core's `found`: there is no route, and there is one if what is solid, but no wall, goes."""
EVIDENCE_HIT, EVIDENCE_LOW, EVIDENCE_HIGH = 30, -20, 60
"""Log-odds of the map: one hit makes the surest free cell (low) solid; high is the surest solid one."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What N robots did in the last n steps. Arrays (N,)."""

    travelled_m: Array
    """Cumulative displacement: length of the way driven."""
    progress_m: Array
    """Decrease of the distance to the goal."""
    net_m: Array
    """Distance between the first and the last place."""
    obstacle_change_m: Array
    """Change of the nearest obstacle's distance between the first and the last step, unsigned."""
    duration_s: Array | float


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """Of eq 18. Arrays (N,), or numbers."""

    displacement_m: Any
    speed_mps: Any
    obstacle_change_m: Any


def adapt(basic: Thresholds, threat: Array, maturity: float, config: ReplannerConfig) -> Thresholds:
    """Eqs 19 and 20: d_m = d_m0 (1 + alpha T_obs), then divided by 1 + beta S; all three thresholds alike.

    Literal eq 20 multiplies by 1 + beta S: a mature policy is interrupted more often, where the text wants less.
    """
    phase = 1.0 + config.maturity_gain * maturity
    factor = (1.0 + config.environment_gain * threat) * (phase if config.eq20 == "literal" else 1.0 / phase)
    return Thresholds(
        displacement_m=basic.displacement_m * factor,
        speed_mps=basic.speed_mps * factor,
        obstacle_change_m=basic.obstacle_change_m * factor,
    )


def stagnant(motion: Motion, thresholds: Thresholds, form: Form) -> Mask:
    """Eq 18, (N,).

    Literal: cumulative displacement < d_m and change of obstacle distance < delta. A robot that oscillates or
    circles in a trap drives far, and never fulfils it. Corrected: progress to the goal < d_m, and
    net displacement / time < v_min, and the change < delta. Progress never exceeds the net displacement, so it
    covers that too. The speed is the one made good: standing, oscillating and circling robots have none, one on
    a fast detour has. The change is taken from the first to the last step: an oscillating robot is, every now
    and then, as far from its obstacle as it was.
    """
    unchanged = motion.obstacle_change_m < thresholds.obstacle_change_m
    if form == "literal":
        return (motion.travelled_m < thresholds.displacement_m) & unchanged
    slow = motion.net_m < thresholds.speed_mps * motion.duration_s
    return (motion.progress_m < thresholds.displacement_m) & slow & unchanged


def on_course(motion: Motion, least_m: Array | float) -> Mask:
    """(N,) robots of which most of the way brought them nearer to the goal; least_m: less is not driving."""
    return (motion.progress_m > 0.7 * motion.travelled_m) & (motion.travelled_m > least_m)


class Replanner:
    """Waypoints for N robots. All that changes is in the arrays `b`: see state(). `native` is the core's.

    Poses and goals are in the frame of the odometry. `replans` (N,) counts the interventions since reset.
    """

    def __init__(
        self,
        num_robots: int,
        robot: RobotConfig | Sequence[RobotConfig],
        config: ReplannerConfig | None = None,
        *,
        maturity: float = 0.0,
        num_threads: int = 1,
        kind: NDArray[np.intp] | None = None,
        tells_path: bool = False,
    ) -> None:
        """maturity: S of the policy (eq 20). num_threads: 0 takes one per core. robot, kind: as in LocalControl.

        tells_path: keep path_ahead.
        """
        self.config = config or ReplannerConfig()
        robots = (robot,) if isinstance(robot, RobotConfig) else tuple(robot)
        self.maturity = maturity
        self.kind = np.zeros(num_robots, np.intp) if kind is None else kind
        """(N,) which of the robots each row is: the caller's array, where one was given."""
        self._robots = RobotRows.of(robots)
        self._windows = np.array([self.config.steps(self.config.window_s, one) for one in robots])
        self._intervals = np.array([self.config.steps(self.config.replan_interval_s, one) for one in robots])
        self._extents = _extents(robots)
        self.b = _buffers(num_robots, self._windows.max() + 1, self.config.cells)
        if tells_path:
            self.b |= route_buffers(num_robots)
            self.b["path_ahead"] = np.zeros((num_robots, len(PATH_POINTS_M), 2))
        setups = [_setup(self.config, one) for one in robots]
        self.native = _core.Replanner(num_robots, num_threads, setups, self.b | {"kind": self.kind})

    @property
    def interval(self) -> NDArray[np.int64]:
        """(N,) control periods after which a plan is old."""
        return self._intervals[self.kind]

    @property
    def replans(self) -> NDArray[np.int64]:
        """(N,) interventions since the robot's reset."""
        return self.b["replans"]

    @property
    def following(self) -> Mask:
        """(N,) robots that follow a route of their own rather than the goal."""
        return self.b["following"].astype(bool)

    @property
    def beyond_m(self) -> Array:
        """(N,) metres of route from the waypoint to the goal; 0 for a robot that heads for the goal itself."""
        return self.b["beyond"]

    @property
    def path_ahead(self) -> Array | None:
        """(N, P, 2) points of each robot's way PATH_POINTS_M ahead of where it was at the last update: of its route, or
        of the straight line to the goal. None of a Replanner that does not tell the path."""
        return self.b.get("path_ahead")

    @property
    def waypoints(self) -> Array:
        """(N, 2) where to head for: a copy."""
        return np.where(self.following[:, None], self.b["waypoint"], self.b["goal"])

    def as_goals(self, towards: Array, rows: Rows = slice(None)) -> Array:
        """(M, 2) waypoints of the robots `rows`, in their frames -> where a policy is shown its goal.

        In the same direction, at least lookahead_m away, but never farther than the goal along the route: a waypoint is
        passed, not arrived at. A policy that was trained with the goal alone has seen no other point so near, and
        drives straight at it, as its episode ends there, whatever stands beside the way. With `near` where it is, but
        at most as far away as guidance `map` shows one.
        """
        distance = np.maximum(np.hypot(towards[:, 0], towards[:, 1]), 1e-9)
        if self.config.near:
            return towards * np.minimum(LOOKAHEAD_M / distance, 1.0)[:, None]
        shown = np.minimum(self.config.lookahead_m, distance + self.beyond_m[rows])
        return towards * np.maximum(shown / distance, 1.0)[:, None]

    def reset(self, indices: NDArray[np.intp], goals: Array, odometry: Array) -> None:
        """Begin anew with robots `indices` (M,): goals (M, 2), odometry (M, 3) where they stand. The map is empty."""
        b = self.b
        mask = np.zeros(len(b["goal"]), dtype=np.uint8)
        mask[indices] = 1
        poses = np.zeros((len(mask), 3))
        poses[indices] = odometry
        b["replans"][indices] = 0
        self.retarget(indices, goals)
        self.native.restart(mask, poses)

    def retarget(self, indices: NDArray[np.intp], goals: Array) -> None:
        """Other goals (M, 2) for robots `indices` (M,) under way: what they have mapped stays."""
        b = self.b
        b["goal"][indices] = goals
        for name in ("following", "recorded", "beyond"):
            b[name][indices] = 0
        b["since_plan"][indices] = self.interval[indices]  # a plan may be made at once

    def move_goals(self, indices: NDArray[np.intp], goals: Array) -> None:
        """The same goals (M, 2) of robots `indices` (M,), better known: the route stays, the next plan leads there."""
        self.b["goal"][indices] = goals

    def update(self, ranges: F32, odometry: Array, active: Mask | None = None) -> Array:
        """One control period: (N, K) ranges, (N, 3) odometry -> (N, 2) waypoints.

        A range that is not finite or not positive tells nothing. active (N,): the other robots are left as they are.
        """
        b = self.b
        awake = np.ones(len(odometry), dtype=bool) if active is None else np.asarray(active, dtype=bool)
        odometry = np.ascontiguousarray(odometry, dtype=np.float64)
        self.native.observe(awake.astype(np.uint8), odometry, np.ascontiguousarray(ranges, dtype=np.float32))
        clearance = self._clearance(ranges)
        self._record(awake, odometry, clearance)
        following = b["following"].astype(bool)
        triggered = self._triggered(awake & ~following, odometry, clearance)
        b["replans"][triggered] += 1
        b["since_plan"][awake] += 1
        self._plan(triggered | self._due(awake & following, odometry), odometry)
        if "path_ahead" in b:
            self._look_ahead(awake, odometry)
        return self.waypoints

    def sees(self, start: Array, end: Array) -> bool:
        """Whether the first robot knows of nothing on the straight way from (x, y) to (x, y)."""
        poses = np.zeros((len(self.b["goal"]), 3))
        poses[0, :2] = start
        mask = np.zeros(len(poses), dtype=bool)
        mask[0] = True
        return bool(self._sees(mask, poses, np.broadcast_to(end, (len(poses), 2)).copy(), np.inf)[0])

    def state(self) -> dict[str, NDArray[Any]]:
        """Copies of all that changes."""
        return {name: array.copy() for name, array in self.b.items()}

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what state() returned."""
        for name, array in self.b.items():
            array[:] = state[name]

    def _clearance(self, ranges: F32) -> Array:
        """(N,) metres from the footprint to the nearest hit. Beams that tell nothing count as free."""
        told = np.isfinite(ranges) & (ranges > 0.0)
        seen = np.where(told, ranges, self._robots.max_range_m.astype(np.float32)[self.kind, None])
        return np.maximum((seen - self._extents[self.kind]).min(axis=1), 0.0)

    def _record(self, awake: Mask, odometry: Array, clearance: Array) -> None:
        b = self.b
        for name, newest in (("places", odometry[:, :2]), ("clearances", clearance)):
            b[name][awake, :-1] = b[name][awake, 1:]
            b[name][awake, -1] = newest[awake]
        b["recorded"][awake] = np.minimum(b["recorded"] + 1, self._windows[self.kind] + 1)[awake]

    def _motion(self) -> Motion:
        places, clearances, goal = self.b["places"], self.b["clearances"], self.b["goal"]
        window = self._windows[self.kind]
        # Windows end together; the longest begins in column 0.
        first, rows = places.shape[1] - 1 - window, np.arange(len(window))
        ways = np.hypot(*np.moveaxis(np.diff(places, axis=1), 2, 0))
        ways[np.arange(ways.shape[1]) < first[:, None]] = 0.0
        begun, ended = places[rows, first], places[:, -1]
        return Motion(
            # Summed in the order of time: what lies before a shorter window adds nothing, to the byte.
            travelled_m=ways.cumsum(axis=1)[:, -1],
            progress_m=np.hypot(*(goal - begun).T) - np.hypot(*(goal - ended).T),
            net_m=np.hypot(*(ended - begun).T),
            obstacle_change_m=np.abs(clearances[:, -1] - clearances[rows, first]),
            duration_s=window * self._robots.control_period_s[self.kind],
        )

    def _triggered(self, heading_on: Mask, odometry: Array, clearance: Array) -> Mask:
        """(N,) robots of those that head for the goal for which eq 18 holds, once the window is full.

        Corrected: but not for a robot on course over free ground: however slow it drives, a plan would be the straight
        line it follows already. And at once for one with a known obstacle within foresight_m of its straight way:
        whoever waits until it is stuck has driven into the trap, and drives out of it again.
        """
        robots, window = self._robots[self.kind], self._windows[self.kind]
        span_m = robots.max_speed_mps * robots.control_period_s * window
        basic = Thresholds(
            displacement_m=self.config.displacement_fraction * span_m,
            speed_mps=self.config.speed_fraction * robots.max_speed_mps,
            obstacle_change_m=self.config.obstacle_change_m,
        )
        threat = np.clip(1.0 - clearance / self.config.safe_clearance_m, 0.0, 1.0)
        thresholds = adapt(basic, threat, self.maturity, self.config)
        full = self.b["recorded"] > window
        motion = self._motion()
        stuck = heading_on & full & stagnant(motion, thresholds, self.config.eq18)
        if self.config.eq18 == "literal":
            return stuck
        straight_on = stuck & on_course(motion, 0.01 * span_m)
        stuck &= ~self._sees(straight_on, odometry, self.b["goal"], self.config.conflict_m)
        if self.config.foresight_m > 0.0:
            # Where the last plan found no way, the next one waits its time.
            asked = heading_on & ~stuck & (self.b["since_plan"] >= self.interval)
            stuck |= asked & ~self._sees(asked, odometry, self.b["goal"], self.config.foresight_m)
        return stuck

    def _due(self, following: Mask, odometry: Array) -> Mask:
        """(N,) robots on a route that need a new plan: in time, at the waypoint, or cut off from it."""
        b = self.b
        due = following & (b["since_plan"] >= self.interval)
        rest = following & ~due & (b["since_plan"] >= LEAST_STEPS)
        arrived = np.hypot(*(b["waypoint"] - odometry[:, :2]).T) < self.config.arrival_m
        due |= rest & arrived
        rest &= ~arrived
        return due | (rest & ~self._sees(rest, odometry, b["waypoint"], np.inf))

    def _plan(self, chosen: Mask, odometry: Array) -> None:
        """Plan for the chosen robots, or hand them back to the goal."""
        if not chosen.any():
            return
        b = self.b
        if "path_ahead" in b:
            self.native.plan_routes(
                chosen.astype(np.uint8), odometry, b["goal"], b["corners"], b["num_corners"]
            )
            b["along"][chosen] = 0.0
        else:
            self.native.plan(chosen.astype(np.uint8), odometry, b["goal"])
        back = chosen & (b["found"] == NO_ROUTE)
        back |= self._sees(chosen, odometry, b["goal"], np.inf, known=True)
        ahead = np.hypot(*(b["waypoint"] - odometry[:, :2]).T)
        left = np.hypot(*(b["goal"] - b["waypoint"]).T)
        b["beyond"][chosen] = np.where(back, 0.0, np.maximum(b["route"] - ahead, left))[chosen]
        b["following"][chosen] = ~back[chosen]
        b["since_plan"][chosen] = 0
        # Whoever goes back to the goal is watched anew.
        b["recorded"][back] = 0

    def _look_ahead(self, awake: Mask, odometry: Array) -> None:
        b = self.b
        following = b["following"].astype(bool)
        on_route = (awake & following).astype(np.uint8)
        self.native.ahead(on_route, odometry, b["corners"], b["num_corners"], b["along"], b["path_ahead"])
        straight = awake & ~following
        here = odometry[straight, None, :2]
        way = b["goal"][straight, None] - here
        length = np.maximum(np.hypot(way[..., 0], way[..., 1]), 1e-9)
        b["path_ahead"][straight] = here + way * np.minimum(PATH_POINTS_M / length, 1.0)[..., None]

    def _sees(
        self, mask: Mask, odometry: Array, points: Array, distance_m: float, *, known: bool = False
    ) -> Mask:
        """(N,) robots of the mask that know of nothing on the straight way to a point, for distance_m of it.

        known: and have seen all of that line.
        """
        out = np.zeros(len(mask), dtype=np.uint8)
        if mask.any():
            self.native.see(mask.astype(np.uint8), odometry, points, distance_m, known, out)
        return out.astype(bool)


def route_buffers(n: int) -> dict[str, NDArray[Any]]:
    """Routes of N robots pulled taut: corners (N, ROUTE_CORNERS, 2), num_corners (N,) of them, and along (N,) m, how
    far each robot has come."""
    return {
        "corners": np.zeros((n, _core.ROUTE_CORNERS, 2)),
        "num_corners": np.zeros(n, np.int32),
        "along": np.zeros(n),
    }


def _extents(robots: Sequence[RobotConfig]) -> F32:
    """(R, K) distance from the LiDAR to the footprint's edge along each beam; where a robot has fewer, none is near."""
    most = max(robot.lidar.num_beams for robot in robots)
    extents = np.full((len(robots), most), -np.inf, np.float32)
    for row, robot in zip(extents, robots, strict=True):
        angles = robot.lidar.angles_rad + robot.lidar.mount_yaw_rad
        row[: len(angles)] = footprint_extent(robot, angles)
    return extents


def _setup(config: ReplannerConfig, robot: RobotConfig) -> "_core.ReplannerSetup":
    evidence = _core.Evidence()
    evidence.hit, evidence.low, evidence.high = EVIDENCE_HIT, EVIDENCE_LOW, EVIDENCE_HIGH
    # A cell near the robot is seen through in every scan.
    evidence.miss = max(1, round(EVIDENCE_HIGH * robot.control_period_s / config.forget_s))
    rules = _core.WaypointRules()
    rules.min_interval_m, rules.max_distance_m = config.min_interval_m, config.lookahead_m
    rules.corridor_m = robot.circumscribed_radius_m + 0.5 * config.margin_m
    rules.literal = config.eq21 == "literal"
    lidar = robot.lidar
    return _core.ReplannerSetup(
        height=config.cells,
        width=config.cells,
        resolution_m=config.resolution_m,
        evidence=evidence,
        beams=(lidar.num_beams, lidar.angle_min_rad, lidar.angle_increment_rad),
        mount=lidar.mount,
        max_range_m=lidar.max_range_m,
        reach_m=config.range_m,
        body_radius_m=inscribed_radius_m(robot),
        costs=config.route_costs(robot),
        waypoint=rules,
        car=robot.native if robot.is_car else None,
        car_margin_m=config.margin_m + 0.5 * config.resolution_m,  # solid cells are known by their centres
    )


def _buffers(n: int, window: int, cells: int) -> dict[str, NDArray[Any]]:
    shapes: dict[str, tuple[tuple[int, ...], Any]] = {
        "log_odds": ((n, cells, cells), np.int8),
        "origin": ((n, 2), np.int64),
        "parity": ((n,), np.uint8),
        "waypoint": ((n, 2), np.float64),
        "route": ((n,), np.float64),
        "found": ((n,), np.uint8),
        "beyond": ((n,), np.float64),
        "goal": ((n, 2), np.float64),
        "places": ((n, window, 2), np.float64),
        "clearances": ((n, window), np.float64),
        "recorded": ((n,), np.int64),
        "following": ((n,), np.uint8),
        "since_plan": ((n,), np.int64),
        "replans": ((n,), np.int64),
    }
    return {name: np.zeros(shape, dtype=dtype) for name, (shape, dtype) in shapes.items()}
