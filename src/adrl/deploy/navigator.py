"""A trained policy on one robot: scans, odometry and a goal in, a velocity out. The same code as in training.

    navigator = Navigator.load("runs/mine")
    navigator.set_goal((3.0, 1.0))
    while running:                                  # once a control period
        command = navigator.step(scan, odometry, now_s)
        base.send(*command.twist)

No clock, no threads, no middleware: time is an argument, and the caller sends and receives.
"""

import logging
import math
import os
from typing import Any, Self

import numpy as np

from adrl.deploy.final_turn import FinalTurn
from adrl.deploy.given_path import GivenPathGuide
from adrl.deploy.guidance import (
    ONE,
    Guide,
    Heading,
    KnownMapGuide,
    OwnMapGuide,
    View,
    check_guidance,
    drivable_m,
)
from adrl.deploy.lidar import LidarAdapter
from adrl.deploy.messages import Command, Odometry, Pose, Reason, Scan, Status, Twist
from adrl.deploy.policies import ResolvedPolicy, act, begin, find_policy
from adrl.deploy.recovery import WAY_M, Recovery
from adrl.deploy.scan_reader import ScanReader
from adrl.deploy.supervisor import CAUTIONS, DEFAULT, Supervisor, SupervisorConfig
from adrl.errors import ConfigError, PlanningError
from adrl.geometry import nearest_on_segments
from adrl.observation import Encoder, ObservationEncoder, in_robot_frame, needs_path, to_action, to_twist
from adrl.observation.motion import ScanHistory
from adrl.planning.replanner import Replanner
from adrl.types import GOAL_TOLERANCE_M, Array, Policy, RobotConfig, World

LOG = logging.getLogger("adrl.deploy")

YAW_TOLERANCE_RAD = 0.25
"""Of the heading that a goal asks for; Nav2's."""
PATH = "path"
"""The guidance along a path of another planner, without a map. To a policy it is guidance `map`."""
USUAL = CAUTIONS | {"limited"}
"""What a base does with a command in training, too: there a policy is told what it asked for."""
NEW_FRAME = frozenset[Reason](("odometry_jumped", "clock_jumped"))
"""After these, what was known of places and times is so no more."""
STILL_SEEING = frozenset[Reason](("odometry_frozen", "not_localised"))
"""Held by these, what the LiDAR shows is still where odometry says."""


class Navigator:
    """Drives one robot to goals. Call step() once a control period of the robot the policy was trained on.

    Goals, waypoints and plans are in the frame of the odometry, with guidance `map` in the map's.
    """

    def __init__(
        self,
        policy: str | os.PathLike[str] | Policy | ResolvedPolicy,
        *,
        robot: RobotConfig | None = None,
        guidance: str | None = None,
        world: World | None = None,
        mount: Pose | None = None,
        zero_is_free: bool = False,
        nan_is_free: bool = False,
        goal_tolerance_m: float = GOAL_TOLERANCE_M,
        yaw_tolerance_rad: float = YAW_TOLERANCE_RAD,
        supervisor: SupervisorConfig | None = DEFAULT,
        recovery: bool = True,
    ) -> None:
        """policy: in any form of find_policy. robot: the one that is there; that of the policy's training when None.
        guidance: as trained when None; `path` follows those of another planner, and needs no map. world: the known
        map of guidance `map`. mount: of the robot's LiDAR, the robot's when None; zero_is_free, nan_is_free: see
        ScanReader. supervisor: None drives without one: in simulation only. recovery: a robot that the supervisor holds
        for long turns to a free way by itself.

        Raises CheckpointError, UnknownName and ConfigError.
        """
        if not 0.0 < goal_tolerance_m < math.inf:
            raise ConfigError(f"goal_tolerance_m is {goal_tolerance_m}; give metres, more than 0")
        if not yaw_tolerance_rad > 0.0:
            raise ConfigError(f"yaw_tolerance_rad is {yaw_tolerance_rad}; give radians, more than 0")
        found = find_policy(policy)
        self.policy = found.policy
        self.robot = _robot(found, robot)
        self.other_robot = found.strange(self.robot)
        """What is other on this robot than on those that the policy was trained for, in words; None for nothing."""
        self._as_trained = found.taken_as(self.robot)
        self.guidance = PATH if guidance == PATH else found.require_guidance(guidance)
        check_guidance(self.guidance, world)
        self.goal_tolerance_m, self.yaw_tolerance_rad = goal_tolerance_m, yaw_tolerance_rad
        self.speed_limit_mps = math.inf
        """Greatest speed that is asked for from now on, whatever the policy wants."""
        self.supervisor = (
            None
            if supervisor is None
            else Supervisor(
                self.robot, supervisor, mount=mount, zero_is_free=zero_is_free, nan_is_free=nan_is_free
            )
        )
        self._read = ScanReader(zero_is_free=zero_is_free, nan_is_free=nan_is_free)
        self._recovery = Recovery(self.supervisor) if recovery and self.supervisor is not None else None
        self.goal: tuple[float, float] | None = None
        if mount is not None and (np.shape(mount) != (3,) or not np.isfinite(mount).all()):
            raise ConfigError(f"mount is {mount}; give x (m), y (m) and yaw (rad) of the LiDAR on the robot")
        self._adapter = LidarAdapter(self._as_trained.lidar, mount)
        self._encoder: Encoder = (
            found.encoder
            if isinstance(found.encoder, Encoder)
            else ObservationEncoder(self._as_trained, found.encoder)
        )
        self._needs_path = needs_path(self._encoder)
        steps = self._encoder.history_steps
        self._history = ScanHistory(1, self.robot.lidar.num_beams, steps) if steps > 0 else None
        self.guide = Guide()
        """Where to head for."""
        if world is not None:
            self.guide = KnownMapGuide(world, self.robot, goal_tolerance_m)
        elif self.guidance in ("replan", PATH):
            replanner = Replanner(
                1, self._as_trained, found.replanner, maturity=found.maturity, tells_path=self._needs_path
            )
            self.guide = (
                OwnMapGuide(replanner)
                if self.guidance == "replan"
                else GivenPathGuide(replanner, car=self.robot.is_car)
            )
        if self.guidance == PATH:
            found.require_guidance("map")
        self._turn: FinalTurn | None = None
        """To the heading that the goal asks for."""
        self._turning = False
        """The robot has arrived, and turns."""
        self._begun = False
        """The policy has been told of the episode that drives to the goal."""
        self._interrupted = True
        """The last step was not driven: scans before and after it are not a control period apart."""
        self._last: tuple[Pose, float] | None = None
        self._action = to_action(np.zeros((1, 2)), self._as_trained)

    @property
    def is_turning(self) -> bool:
        """Whether the robot has arrived, and turns to the heading that the goal asks for."""
        return self._turning

    @property
    def recoveries(self) -> int:
        """Ways out that were taken since the navigator began."""
        return 0 if self._recovery is None else self._recovery.ways

    @classmethod
    def load(cls, policy: str | os.PathLike[str], **options: Any) -> Self:
        """The navigator of a policy: a run folder, a name, a file or module:object; options are those of the
        constructor. Raises AdrlError."""
        return cls(policy, **options)

    def set_goal(
        self, goal: tuple[float, float], path: Array | None = None, *, yaw_rad: float | None = None
    ) -> None:
        """Drive to (x, y) from the next step on; on the way, turn to it there.

        path: (P, 2) of another planner to follow with guidance `map` or `path`; ADRL plans its own when None. yaw_rad:
        the heading to turn to on arrival, any when None, and any for a car, which is logged. Raises ConfigError.
        """
        if not np.isfinite(goal).all():
            raise ConfigError(f"goal {goal} is not finite; give metres")
        if yaw_rad is not None and not math.isfinite(yaw_rad):
            raise ConfigError(f"the heading {yaw_rad} is not finite; give radians, or leave it out")
        if path is not None:
            path = _checked_path(path)
        before, place = self.goal, (float(goal[0]), float(goal[1]))
        is_near = before is not None and math.dist(before, place) < WAY_M
        if not (is_near and path is None and not self.guide.follows_given_path):
            self.guide.set_goal(path)
        # Else the same, better known: as one that follows a person, or is given again and again.
        self.goal = place
        if not is_near and self._recovery is not None:
            self._recovery.forget()
        if place != before:
            self._turning = False  # it may not be there yet
        wanted = self._turn and self._turn.yaw_rad
        if not is_near or yaw_rad != wanted:
            self._turning = False
            self._turn = None
            if yaw_rad is not None and self.robot.is_car:
                LOG.warning(
                    "robot %s cannot turn on the spot: the goal's heading is left out", self.robot.name
                )
            elif yaw_rad is not None:
                self._turn = FinalTurn(self.robot, yaw_rad, self.yaw_tolerance_rad)

    def move_goal(
        self, goal: tuple[float, float], path: Array | None = None, *, yaw_rad: float | None = None
    ) -> None:
        """The goal is the same, and its place better known, as localisation tells; so are its path and its heading.
        What was seen, the route and the recovery's memory stay."""
        if self.goal is None:
            return
        self.goal = (float(goal[0]), float(goal[1]))
        if path is not None:
            self.guide.move_path(path)
        if self._turn is not None and yaw_rad is not None:
            self._turn.yaw_rad = yaw_rad

    def cancel(self) -> None:
        """Stop at the next step, and wait for a goal."""
        self.goal = self._turn = None
        self._begun = self._turning = False
        self.guide.wait()

    def step(
        self,
        scan: Scan | None,
        odometry: Odometry | None,
        now_s: float,
        *,
        map_pose: Pose | None = None,
        has_base: bool = True,
    ) -> Command:
        """The command for the control period that begins at now_s.

        scan, odometry: what has come since the last step; None for nothing. map_pose: where the robot is on the map of
        guidance `map`, by odometry when None; with a coordinate that is not finite the robot stands. has_base: False
        while there is no goal and the command is not sent, for another to drive the base.
        """
        faults = self._watch(scan, odometry, now_s)
        if map_pose is not None and not np.isfinite(map_pose).all():
            faults = (*faults, "not_localised")
        if faults or self.goal is None:
            self._look_while_held(faults, now_s)
            return self._stand("idle" if self.goal is None else "stopped", now_s, faults, has_base=has_base)
        if self.supervisor is not None:
            scan, odometry = self.supervisor.newest()
        else:
            scan = scan and self._read(scan)
        assert scan is not None
        assert odometry is not None
        place = odometry.pose if map_pose is None or self.guidance != "map" else map_pose
        try:
            if self._turning or self._arrived(place, self.goal, now_s):
                return self._end(place, self.goal, now_s)
            return self._drive(scan, odometry, place, self.goal, now_s)
        except PlanningError as error:
            self.cancel()
            return self._stand("failed", now_s, message=str(error))

    def withhold(self, now_s: float, reason: Reason = "command_late") -> Command:
        """The command instead of one that took so long to make that what it was checked against is no longer so, or
        where the caller knows another reason to stand."""
        return self._stand("idle" if self.goal is None else "stopped", now_s, (reason,))

    def _drive(
        self, scan: Scan, odometry: Odometry, place: Pose, goal: tuple[float, float], now_s: float
    ) -> Command:
        """One step of NavSim: guidance, encoder, policy; then the supervisor. Raises PlanningError."""
        view = self._view(scan, odometry, place, now_s)
        heading = self.guide.head_for(view, goal)
        self.goal = heading.goal
        self._remember(view)
        towards = in_robot_frame(np.array([place]), np.array([heading.waypoint]))
        shown, measured = self.guide.as_shown(towards), np.array([odometry.twist])
        seen = self._encoder.encode(
            view.ranges, shown, measured, self._action, self._history, *self._told_path(place, heading)
        )
        if not self._begun:
            begin(self.policy, ONE)
        self._begun = True
        action = act(self.policy, seen, require_finite=False)
        if not np.isfinite(action).all():
            return self._stand("stopped", now_s, ("command_invalid",))
        self._action = np.clip(action, -1.0, 1.0)
        twist, reasons = self._limit(towards[0], now_s)
        self._interrupted = False
        self._last = (place, now_s)
        return Command(
            twist=twist,
            status="driving",
            reasons=reasons,
            waypoint=heading.waypoint,
            plan=heading.plan,
            distance_m=heading.distance_m,
        )

    def _told_path(self, place: Pose, heading: Heading) -> tuple[Array, ...]:
        """The path ahead as an encoder that needs it takes it, (1, P, 2) in the robot's frame; nothing for others."""
        if not self._needs_path:
            return ()
        assert heading.path is not None
        return (in_robot_frame(np.array([place]), heading.path)[None],)

    def _end(self, place: Pose, goal: tuple[float, float], now_s: float) -> Command:
        """At the goal: stand, or turn to its heading first. Raises PlanningError."""
        wanted = None if self._turn is None else self._turn.twist(place[2], now_s)
        if wanted is None:
            self.cancel()
            return self._stand("reached", now_s)
        self._turning = self._interrupted = True
        twist, reasons = (wanted, ()) if self.supervisor is None else self.supervisor.limit(wanted, now_s)
        self._action = to_action(np.array([twist]), self._as_trained)
        plan = np.array([place[:2], goal])
        return Command(
            twist=twist,
            status="driving",
            reasons=reasons,
            waypoint=goal,
            plan=plan,
            distance_m=math.dist(place[:2], goal),
        )

    def _view(self, scan: Scan, odometry: Odometry, place: Pose, now_s: float) -> View:
        return View(
            ranges=self._adapter(scan)[None],
            reckoned=np.array([odometry.pose]),
            place=place,
            now_s=now_s,
        )

    def _look_while_held(self, faults: tuple[Reason, ...], now_s: float) -> None:
        if self.supervisor is None or self.goal is None:
            return
        if "odometry_jumped" in faults:
            self.guide.forget()
        elif STILL_SEEING.issuperset(faults):
            scan, odometry = self.supervisor.newest()
            self.guide.look(self._view(scan, odometry, odometry.pose, now_s), self.goal)

    def _watch(self, scan: Scan | None, odometry: Odometry | None, now_s: float) -> tuple[Reason, ...]:
        if self.supervisor is not None:
            return self.supervisor.watch(scan, odometry, now_s)
        missing: dict[Reason, object] = {"no_scan": scan, "no_odometry": odometry}
        return tuple(reason for reason, message in missing.items() if message is None)

    def _limit(self, towards: Array, now_s: float) -> tuple[Twist, tuple[Reason, ...]]:
        """What is sent instead of the policy's action. towards: (2,) the waypoint in the robot's frame."""
        v, w = to_twist(self._action, self._as_trained)[0].tolist()
        if self.supervisor is None:
            return self._slowed((v, w)), ()
        helped = None
        if self._recovery is not None:
            helped = self._recovery.twist(math.atan2(towards[1], towards[0]), now_s)
        twist, reasons = self.supervisor.limit(self._slowed(helped or (v, w)), now_s)
        if self._recovery is not None:
            self._recovery.watch(now_s)
        if helped is not None:
            reasons = (*reasons, "recovering")
        if not USUAL.issuperset(reasons):  # the policy is told what the base was told
            self._action = to_action(np.array([twist]), self._as_trained)
        return twist, reasons

    def _slowed(self, twist: Twist) -> Twist:
        """Within the speed limit, on the same arc."""
        v, w = twist
        if abs(v) <= self.speed_limit_mps:
            return twist
        return math.copysign(self.speed_limit_mps, v), self.speed_limit_mps / abs(v) * w

    def _stand(
        self,
        status: Status,
        now_s: float,
        reasons: tuple[Reason, ...] = (),
        message: str = "",
        *,
        has_base: bool = True,
    ) -> Command:
        if self.supervisor is not None:
            (self.supervisor.stop if has_base else self.supervisor.stand_by)(now_s, reasons)
        if self._recovery is not None and (status != "stopped" or not NEW_FRAME.isdisjoint(reasons)):
            self._recovery.forget()
        self._interrupted = True
        self._action = to_action(np.zeros((1, 2)), self._as_trained)
        return Command(
            twist=(0.0, 0.0), status=status, reasons=reasons, message=message, plan=np.empty((0, 2))
        )

    def _arrived(self, place: Pose, goal: tuple[float, float], now_s: float) -> bool:
        """Whether the robot is at the goal, or has driven across its disc since the last step.

        Localisation that finds it beyond the goal has not driven it there.
        """
        if not self.guide.may_arrive:
            return False
        here, there = np.array(place[:2]), np.array(goal)
        before = here
        if self._last is not None and not self._interrupted:
            last = np.array(self._last[0][:2])
            before = last if math.dist(last, here) <= drivable_m(self.robot, self._last[1], now_s) else here
        return math.dist(nearest_on_segments(before, here, there), there) < self.goal_tolerance_m

    def _remember(self, view: View) -> None:
        if self._history is None:
            return
        if self._interrupted:
            self._history.begin(ONE, view.ranges, view.reckoned)
        else:
            self._history.add(view.ranges, view.reckoned)


def _checked_path(path: Array) -> Array:
    """(P, 2) of another planner. Raises ConfigError."""
    if np.ndim(path) != 2 or np.shape(path)[1] != 2 or len(path) == 0 or not np.isfinite(path).all():
        raise ConfigError(f"the path has shape {np.shape(path)}; give (P, 2) finite metres, P at least 1")
    return np.asarray(path, dtype=np.float64)


def _robot(policy: ResolvedPolicy, robot: RobotConfig | None) -> RobotConfig:
    """The robot that drives. Raises ConfigError where nothing says which, or the policy can drive none."""
    if policy.knows_the_world:
        raise ConfigError(f"policy {policy.name} drives in simulators only; give another one")
    if robot is None and policy.robot is None:
        raise ConfigError(f"policy {policy.name} does not say which robot it drives; give robot")
    return policy.driven(robot)
