"""What a robot's node does between its topics, without any middleware: both generations of ROS share it.

    driver = Driver(Navigator.load("runs/mine"))
    driver.set_goal((3.0, 1.0), "odom")
    report = driver.take_scan(scan, now_s)      # when a scan comes: the step, when one is due
    report = driver.tick(now_s)                 # a few times a control period: the step, when no scan comes

No clock, no threads: times are arguments, and one call is made at a time.
"""

import logging
import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from adrl.deploy.frames import Frames, planar
from adrl.deploy.localisation import Localisation
from adrl.deploy.messages import Command, Odometry, Pose, Reason, Scan
from adrl.deploy.navigator import PATH, Navigator
from adrl.deploy.watch import has_jumped, is_plausible
from adrl.errors import BadGoal, ConfigError, GoalRefused, NotLocalised, TransformError, UnknownFrame
from adrl.geometry import compose, in_world_frame
from adrl.types import Array

LOG = logging.getLogger("adrl.driver")

Source = Literal["pose", "tf", "odometry"]
"""Where the place on the map comes from. pose: of a localisation, as AMCL's. tf: of transforms. odometry: its frame is
the map's."""
Outcome = Literal["", "reached", "failed", "cancelled"]
"""How the last goal ended; nothing while it is driven to."""

SLOW = 1.25
"""A LiDAR with so many control periods between two scans is not waited for."""
SMOOTHING = 0.2
"""Weight of the newest time between two scans in their average."""
STOPS = 10
"""Commands to stand still that are sent after a goal has ended; then other sources of commands have the base."""
UNKNOWN: Pose = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a step brought."""

    command: Command
    frame: str
    """Of the command's waypoint and plan."""
    send: bool
    """Whether the command goes to the base. Not while there is no goal, so that others may drive it."""
    goal: tuple[float, float] | None
    """As it was given, in goal_frame."""
    goal_frame: str
    outcome: Outcome
    goals: int
    """Goals that have come so far, refused ones among them."""
    refusal: GoalRefused | None
    """Why the last goal was not taken; until another is, or the one before has ended."""
    message: str
    """For people: why the last goal failed or was refused."""


class Driver:
    """One robot's navigator, its goals in either frame, and the cadence of its steps."""

    def __init__(
        self,
        navigator: Navigator,
        *,
        odom_frame: str = "odom",
        map_frame: str = "map",
        localisation: Source = "pose",
        frames: Frames | None = None,
    ) -> None:
        """frames: of localisation tf. Raises ConfigError."""
        if localisation not in get_args(Source):
            raise ConfigError(f"localisation is {localisation!r}; give one of {', '.join(get_args(Source))}")
        self.navigator = navigator
        self.period_s = navigator.robot.control_period_s
        self._odom_frame, self._map_frame = odom_frame.strip("/"), map_frame.strip("/")
        self._source = localisation
        self._localisation = Localisation()
        self.frames = frames or Frames()
        """Where frames are in each other, as transforms tell."""
        self._lost = ""
        """Why transforms do not tell the place on the map."""
        self._strange_frames: set[tuple[str, str]] = set()
        """What was warned of: whose frame, and which."""
        self._on_map = navigator.guidance == "map"
        self._scan: Scan | None = None
        self._odometry: Odometry | None = None
        self._goal: tuple[float, float] | None = None
        self._path: Array | None = None
        self._yaw_rad: float | None = None
        """As they were given: path and heading of the goal, where it has them."""
        self._goal_frame = ""
        self._outcome: Outcome = ""
        self._goals = self._taken = 0
        self._refusal: GoalRefused | None = None
        self._message = ""
        self._standing: tuple[object, Command] | None = None
        """For which reason, when and with what goal it was told to stand last, and how."""
        self._stops_left = 0
        """The base is ours for so many more commands without a goal."""
        self._now_s = -math.inf
        self._beat_s = -math.inf
        self._scan_s = -math.inf
        self._interval_s = self.period_s

    @property
    def has_base(self) -> bool:
        """Whether commands are sent. Else others may drive the base."""
        return self._stops_left > 0

    @property
    def goals(self) -> int:
        """Goals that have come so far, refused ones among them."""
        return self._goals

    @property
    def taken(self) -> int:
        """Number of the last goal that was not refused; 0 before the first."""
        return self._taken

    @property
    def here(self) -> Pose | None:
        """The robot by the newest odometry."""
        newest = self._localisation.newest
        return None if newest is None else newest.pose

    @property
    def here_on_map(self) -> Pose | None:
        """The robot on the map, where that is known."""
        here = self.here
        if here is None or self._source == "odometry":
            return here
        return self._localisation.to_map(here) if self._localisation.known else None

    @property
    def localised(self) -> bool:
        """Whether the robot's place on the map is known."""
        return self._source == "odometry" or self._localisation.known

    def set_goal(
        self,
        goal: tuple[float, float],
        frame: str,
        *,
        path: Array | None = None,
        yaw_rad: float | None = None,
    ) -> None:
        """Drive to (x, y) of a frame from the next step on, instead of the goal before.

        path: (P, 2) of another planner, for guidance `map` or `path`. yaw_rad: the heading to turn to on arrival.
        Raises GoalRefused: UnknownFrame, NotLocalised, BadGoal. The goal before stays then.
        """
        self._goals += 1
        self._localise()
        try:
            self._check(goal, frame, path, yaw_rad)
        except GoalRefused as refusal:
            self._refusal, self._message = refusal, str(refusal)
            LOG.warning("goal refused: %s: %s", type(refusal).__name__, refusal)
            raise
        self._goal, self._goal_frame = goal, frame.removeprefix("/")
        self._path, self._yaw_rad = path, yaw_rad
        self._outcome, self._refusal, self._message = "", None, ""
        self._taken = self._goals
        place, path, yaw_rad = self._in_navigators_frame()
        self.navigator.set_goal(place, path, yaw_rad=yaw_rad)
        LOG.info("goal (%.2f, %.2f) in %s", *goal, self._goal_frame)

    def cancel(self) -> None:
        """Stand still from the next step on."""
        if self._goal is not None:
            self._end("cancelled")
        self.navigator.cancel()

    def fail(self, message: str) -> None:
        """The same, where the node gives the goal up; message: why."""
        if self._goal is not None:
            self._end("failed", message)
        self.navigator.cancel()

    def take_navigator(self, navigator: Navigator) -> None:
        """Drive by another one from the next step on: the robot is better known. Goal and limits stay."""
        before, self.navigator = self.navigator, navigator
        navigator.speed_limit_mps = before.speed_limit_mps
        navigator.goal_tolerance_m = before.goal_tolerance_m
        navigator.yaw_tolerance_rad = before.yaw_tolerance_rad
        self._odometry = self._localisation.newest
        if self._goal is not None:
            place, path, yaw_rad = self._in_navigators_frame()
            navigator.set_goal(place, path, yaw_rad=yaw_rad)

    def take_odometry(self, odometry: Odometry, frame: str = "") -> None:
        """What the next step is driven by; of no use in another frame than the one it is said to have. Where it begins
        anew, a goal in its frame has lost its place."""
        frames = (self._odom_frame, *((self._map_frame,) if self._source == "odometry" else ()))
        if frame and self._is_strange("odometry", frame, *frames):
            return
        robot, last = self.navigator.robot, self._localisation.newest
        if self._source != "odometry" and last is not None and is_plausible(robot, odometry):
            # Stamps that go back are a clock's jump, not the odometry's.
            later = odometry.stamp_s > last.stamp_s
            if later and has_jumped(robot, last, odometry):
                self._begin_anew()
        self._localisation.take_odometry(odometry)
        self._odometry = odometry

    def take_pose(self, pose: Pose, frame: str, stamp_s: float) -> None:
        """Where a localisation saw the robot; of no use in another frame than the map's."""
        if self._is_strange("poses", frame, self._map_frame):
            return
        if self._source == "pose" and self._localisation.take_pose(pose, stamp_s):
            self._move_goal()

    def take_scan(self, scan: Scan, now_s: float) -> Report | None:
        """A scan; the step that it begins, if one is due or nearly so."""
        self._scan = scan
        if self._scan_s < now_s < self._scan_s + 3.0 * self.period_s:
            self._interval_s += SMOOTHING * (now_s - self._scan_s - self._interval_s)
        self._scan_s = now_s
        return self._step(now_s, now_s) if self._is_due(now_s, -self._slack_s) else None

    def tick(self, now_s: float) -> Report | None:
        """To be called a few times a control period: the step that is overdue without a scan, if any."""
        wait_s = self._slack_s if self._interval_s < SLOW * self.period_s else 0.0
        return self._step(now_s, now_s - wait_s) if self._is_due(now_s, wait_s) else None

    def withhold(self, report: Report, now_s: float) -> Report:
        """Stand still instead: the command took too long to make."""
        return replace(report, command=self.navigator.withhold(now_s))

    def stand(self, reason: Reason, now_s: float) -> Report:
        """Stand still between steps, for a reason that the node knows."""
        since = (reason, now_s, self._goal)
        if self._standing is None or self._standing[0] != since:
            self._standing = (since, self.navigator.withhold(now_s, reason))
        return self._report(self._standing[1], send=self.has_base)

    def _is_strange(self, what: str, frame: str, *known: str) -> bool:
        """Whether a frame is none of those; told once."""
        if frame.removeprefix("/") in known:
            return False
        if (what, frame) not in self._strange_frames:
            self._strange_frames.add((what, frame))
            LOG.warning(
                "%s in frame %r: not used; this robot's is %s", what, frame, " or ".join(map(repr, known))
            )
        return True

    @property
    def _slack_s(self) -> float:
        """How much too early or late the scan may be that a step begins with: the one nearest to when it is due."""
        return 0.5 * min(self._interval_s, self.period_s)

    def _is_due(self, now_s: float, wait_s: float) -> bool:
        since_s = now_s - self._beat_s
        return since_s < -self.period_s or since_s >= self.period_s + wait_s - 1e-9

    def _step(self, now_s: float, beat_s: float) -> Report:
        """beat_s: from when on the next step is counted."""
        if self._now_s - self.period_s <= now_s < self._now_s:
            now_s = self._now_s  # clock and stamps come by different ways; a real jump is longer
        scan, self._scan = self._scan, None
        odometry, self._odometry = self._odometry, None
        if now_s < self._now_s:
            self._localisation.forget_stamps()
            self.frames.forget()
            if odometry is not None:
                self._localisation.take_odometry(odometry)
        self._now_s, self._beat_s = now_s, beat_s
        self._localise()
        if self._goal is not None:
            self._stops_left = STOPS
        send = self.has_base
        command = self.navigator.step(scan, odometry, now_s, map_pose=self._map_pose(), has_base=send)
        if self._goal is not None and command.status in ("reached", "failed"):
            self._end("reached" if command.status == "reached" else "failed", command.message)
        return self._report(command, send=send)

    def _report(self, command: Command, *, send: bool) -> Report:
        if self._goal is None and send:
            self._stops_left -= 1
        return Report(
            command=command,
            frame=self._map_frame if self._on_map else self._odom_frame,
            send=send,
            goal=self._goal,
            goal_frame=self._goal_frame,
            outcome=self._outcome,
            goals=self._goals,
            refusal=self._refusal,
            message=self._message or (self._lost if "not_localised" in command.reasons else ""),
        )

    def _begin_anew(self) -> None:
        """Odometry has jumped: of its frame nothing is known any more."""
        LOG.warning("odometry jumped: the place on the map is unknown until localisation tells it")
        self._localisation.forget()
        self.frames.forget()
        if self._goal is not None and self._goal_frame == self._odom_frame:
            self._end(
                "failed",
                f"the odometry began anew, and with it the frame {self._odom_frame!r}; give the goal again",
            )
            self.navigator.cancel()

    def _map_pose(self) -> Pose | None:
        """Where the robot is on the map, UNKNOWN where that is needed and not known; None where it is not needed."""
        needed = self._goal is not None and (self._on_map or self._goal_frame == self._map_frame)
        if not needed or self._source == "odometry":
            return None
        newest = self._localisation.newest
        if newest is None or not self._localisation.known:
            return UNKNOWN
        return self._localisation.to_map(newest.pose)

    def _localise(self) -> None:
        """With localisation tf: the odometry's frame on the map, at the newest odometry's stamp."""
        newest = self._localisation.newest
        if self._source != "tf" or newest is None:
            return
        try:
            self._localisation.place(
                planar(self.frames.lookup(self._map_frame, self._odom_frame, newest.stamp_s))
            )
        except TransformError as error:
            if not self._lost:
                LOG.warning("not localised: %s", error)
            self._lost = str(error)
            self._localisation.place(None)
            return
        self._lost = ""
        self._move_goal()

    def _move_goal(self) -> None:
        """Its place is better known."""
        if self._goal is not None:
            place, path, yaw_rad = self._in_navigators_frame()
            self.navigator.move_goal(place, path, yaw_rad=yaw_rad)

    def _check(
        self, goal: tuple[float, float], frame: str, path: Array | None, yaw_rad: float | None
    ) -> None:
        """Raises GoalRefused."""
        frames = (self._odom_frame, self._map_frame)
        if frame.removeprefix("/") not in frames:
            raise UnknownFrame(f"the goal is in frame {frame!r}; give it in {' or '.join(frames)}")
        if not all(map(math.isfinite, goal)):
            raise BadGoal(f"the goal {goal} is not finite; give metres")
        if path is not None and not (len(path) > 0 and np.isfinite(path).all()):
            raise BadGoal("the path has no points, or one that is not finite; give metres")
        if path is None and self.navigator.guidance == PATH:
            raise BadGoal("guidance path needs the path to the goal; give it")
        if yaw_rad is not None and not math.isfinite(yaw_rad):
            raise BadGoal("the goal's heading is none: its quaternion is not of length 1")
        on_map = self._on_map or frame.removeprefix("/") == self._map_frame
        if on_map and not self.localised:
            what = "guidance map needs" if self._on_map else f"a goal in {self._map_frame!r} needs"
            raise NotLocalised(
                f"{what} the robot's place on the map, and "
                + (self._lost or f"no localisation has told it: start one that publishes {self._told_by}")
                + ("" if self._on_map else f"; or give the goal in {self._odom_frame!r}")
            )

    @property
    def _told_by(self) -> str:
        return "transforms (/tf), and odometry" if self._source == "tf" else "poses (amcl_pose)"

    def _in_navigators_frame(self) -> tuple[tuple[float, float], Array | None, float | None]:
        """Goal, path and heading in the frame of the odometry, with guidance `map` in the map's."""
        assert self._goal is not None
        goal_on_map = self._goal_frame == self._map_frame
        if goal_on_map == self._on_map or not self._localisation.known:
            return self._goal, self._path, self._yaw_rad
        origin = (0.0, 0.0, 0.0)
        frame = self._localisation.to_map(origin) if self._on_map else self._localisation.to_odom(origin)
        x, y, yaw_rad = compose(frame, (*self._goal, self._yaw_rad or 0.0))
        path = None if self._path is None else in_world_frame(np.array(frame), self._path)
        return (x, y), path, None if self._yaw_rad is None else yaw_rad

    def _end(self, outcome: Outcome, message: str = "") -> None:
        """message: why it failed. A refusal on the way is a thing of the past."""
        assert self._goal is not None
        goal = f"goal ({self._goal[0]:.2f}, {self._goal[1]:.2f}) in {self._goal_frame}"
        if message and self._on_map and self._goal_frame != self._map_frame:
            message = f"{message} (in {self._map_frame}; it was given as the {goal})"
        self._goal, self._path, self._outcome = None, None, outcome
        self._refusal, self._message = None, message
        level = logging.WARNING if outcome == "failed" else logging.INFO
        LOG.log(level, "%s %s%s", goal, outcome, message and f": {message}")
