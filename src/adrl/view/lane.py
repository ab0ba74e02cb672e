"""One robot on the page: our simulator, lines that may be faulty, and on them what runs on a robot."""

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np

from adrl.benchmarks.faults import Fault
from adrl.benchmarks.faulty_lines import FaultyLines, Received, params_of
from adrl.deploy.driver import Driver, Report
from adrl.deploy.guidance import OwnMapGuide
from adrl.deploy.messages import Pose
from adrl.deploy.navigator import Navigator
from adrl.deploy.policies import ResolvedPolicy
from adrl.envs import NavSim
from adrl.errors import GoalRefused
from adrl.geometry import compose, in_world_frame, inverse
from adrl.observation import to_action
from adrl.report.document import FIXED, robot_shape, shown_beams
from adrl.report.encode import numbers, own_map
from adrl.rewards import RewardConfig, reward_terms, weights
from adrl.types import People, RobotConfig, Task, World
from adrl.view.demonstrations import Recorder

TIME, X, Y = 0, 1, 2
"""Columns of a row."""
KEPT = 4000
"""Rows of its past that a page is told when it opens."""
STANDING = 1e-3
"""Speed and yaw rate up to which a robot stands."""
REWARD = RewardConfig()
TERMS = {name: column for column, name in enumerate(reward_terms(REWARD)) if name not in FIXED}
"""Reward terms whose weights change on the way, and their columns."""
MAP, ODOM = "map", "odom"
"""Frames, as ROS calls them: that of the world, where people point, and that of the robot's own reckoning."""


class Lane:
    """A robot on its way, from the start of its task on."""

    def __init__(
        self,
        policy: ResolvedPolicy,
        robot: RobotConfig,
        task: Task,
        fault: Fault,
        *,
        guidance: str | None,
        seed: int,
        recovery: bool = True,
    ) -> None:
        """guidance: None as trained. seed: of the noise. recovery: see Navigator. Raises AdrlError."""
        chosen = policy.require_guidance(guidance)
        world = task.world if chosen == "map" else None
        navigator = Navigator(policy, robot=robot, guidance=chosen, world=world, recovery=recovery)
        self.policy, self.robot, self.guidance = policy, robot, chosen
        self.note = navigator.other_robot or ""
        self.task = task
        self.sim = NavSim(1, robot, guidance="goal")
        self.report: Report | None = None
        self.recorder: Recorder | None = None
        self.collided = False
        self.rows: deque[list[float | None]] = deque(maxlen=KEPT)
        """Of each period: time, x, y, yaw, speed, yaw rate, clearance, weights of TERMS."""
        self._news: list[list[float | None]] = []
        self._driver = Driver(navigator)
        self._wanted: tuple[float, float] | None = task.goal
        """A goal that the driver has not been told yet."""
        self._refusal = ""
        drive = np.random.SeedSequence(seed)
        self._lines = FaultyLines(robot, task.world, drive, fault)
        self._step = 0
        self.sim.reset(np.array([0]), [task], np.array([seed], np.uint64), np.random.default_rng(seed))
        self.set_fault(fault)
        self._weights = np.zeros(len(TERMS))
        self._log()

    # --- what people do ---------------------------------------------------------------------------------------

    def set_fault(self, fault: Fault) -> None:
        """From now on this goes wrong."""
        self._lines.fault = fault
        self.sim.b["params"][0] = params_of(self.robot, fault)

    def set_world(self, world: World) -> None:
        """From now on this stands there. A known map says what it said."""
        self._change(replace(self.task, world=world))
        self._lines.see(world)

    def set_people(self, people: People) -> None:
        """From now on these walk: those who are there, and others after them."""
        self.sim.set_people(0, people)
        self.task = replace(self.task, people=people)

    def set_goal(self, goal: tuple[float, float]) -> None:
        """Drive there from the next period on."""
        if self.recorder is not None:
            self.recorder.cut()
        self._change(replace(self.task, goal=goal, path=np.empty((0, 2))))
        self.sim.b["waypoint"][0] = goal
        self._wanted = goal

    def _change(self, task: Task) -> None:
        self.task = task
        path = task.path if len(task.path) > 1 else np.array([task.start[:2], task.goal])
        self.sim.set_task(0, replace(task, path=path))

    # --- a control period -------------------------------------------------------------------------------------

    def step(self) -> None:
        """One control period. Raises AdrlError where the policy cannot act."""
        if self.collided:
            return
        sim, lines = self.sim, self._lines
        received = lines.receive(sim, 0, self._step)
        if received is not None:
            report = self._driven_by(received)
            if report is not None:
                self.report = report
                if report.send:
                    lines.send(sim, 0, report.command.twist)
        lines.watch_base(sim, 0)
        self._step += 1
        seen = sim.observe() if self.recorder is not None else None
        action = to_action(sim.b["command"], self.robot)
        outcome = sim.step(action)
        if self.recorder is not None and seen is not None:
            self.recorder.add(sim, seen, action, outcome)
        shares = weights(outcome.features, np.float32(self.policy.maturity), REWARD)[0]
        self._weights = shares[list(TERMS.values())]
        self.collided = bool(outcome.collided[0])
        self._log()

    def _driven_by(self, received: Received) -> Report | None:
        """As a robot's node does it: what comes is handed on, and a scan begins a step."""
        driver, now_s = self._driver, received.now_s
        if received.odometry is not None:
            driver.take_odometry(received.odometry, ODOM)
        if received.place is not None:
            driver.take_pose(received.place, MAP, now_s)
        if self._wanted is not None and driver.localised:
            goal, self._wanted = self._wanted, None
            try:
                driver.set_goal(goal, MAP)
                self._refusal = ""
            except GoalRefused as refusal:
                self._refusal = str(refusal)
        if received.scan is not None:
            return driver.take_scan(received.scan, now_s)
        # A node's timer: half a period later it knows that no scan comes.
        return driver.tick(now_s + 0.5 * driver.period_s)

    @property
    def arrived(self) -> bool:
        """Whether it stands at the last goal."""
        return self._wanted is None and self.report is not None and self.report.outcome == "reached"

    @property
    def over(self) -> bool:
        """Whether nothing will move it but a new goal."""
        ended = self._wanted is None and self.report is not None and self.report.goal is None
        return self.collided or (ended and float(np.abs(self.sim.b["twist"][0]).max()) < STANDING)

    # --- what the page shows ----------------------------------------------------------------------------------

    def about(self) -> dict[str, Any]:
        """What does not change on the way."""
        return {
            "label": self.policy.name,
            "guidance": self.guidance,
            "maturity": round(self.policy.maturity, 3),
            "note": self.note,
            "terms": list(TERMS),
            "shape": robot_shape(self.robot),
        }

    def now(self) -> dict[str, Any]:
        """What does."""
        sim, report = self.sim, self.report
        beams = shown_beams(self.robot.lidar.num_beams)
        command = None if report is None else report.command
        to_world = np.array(self._frame_on_map("" if report is None else report.frame))
        waypoint = None if command is None else command.waypoint
        plan = np.empty((0, 2)) if command is None else command.plan
        return {
            "pose": numbers(sim.b["pose"][0]),
            "ranges": numbers(sim.b["ranges"][0][beams], 4),
            "people": numbers(sim.people(0), 4),
            "legs": numbers(sim.legs(0), 4),
            "time_s": round(float(sim.b["time"][0]), 3),
            "goal": list(self.task.goal),
            "tolerance": self.task.goal_tolerance_m,
            "path": numbers(self.task.path, 4) if self.guidance == "map" else [],
            "waypoint": None if waypoint is None else numbers(in_world_frame(to_world, np.array([waypoint]))),
            "plan": numbers(in_world_frame(to_world, plan)) if len(plan) else [],
            "status": "collision" if self.collided else "idle" if command is None else command.status,
            "arrived": self.arrived,
            "reasons": [] if command is None or self.collided else list(command.reasons),
            "message": self._refusal or ("" if report is None else report.message),
            "twist": [0.0, 0.0] if command is None else numbers(command.twist, 3),
        }

    def map(self) -> dict[str, Any] | None:
        """The robot's own map, where its guidance makes one."""
        guide = self._driver.navigator.guide
        if not isinstance(guide, OwnMapGuide):
            return None
        b, resolution_m = guide.replanner.b, guide.replanner.config.resolution_m
        row, column = b["origin"][0].tolist()
        corner = compose(self._frame_on_map(ODOM), (column * resolution_m, row * resolution_m, 0.0))
        return own_map(b["log_odds"][0], resolution_m, corner)

    def _frame_on_map(self, frame: str) -> Pose:
        """Where a frame lies in the world: that of the odometry has drifted as far as the robot's reckoning."""
        if frame != ODOM:
            return (0.0, 0.0, 0.0)
        pose, reckoned = (tuple(self.sim.b[name][0].tolist()) for name in ("pose", "odometry"))
        return compose(pose, inverse(reckoned))

    def _log(self) -> None:
        b = self.sim.b
        row = [b["time"][0], *b["pose"][0], *b["twist"][0], b["clearance"][0], *self._weights]
        self.rows.append(numbers(row))
        self._news.append(self.rows[-1])

    def news(self) -> list[list[float | None]]:
        """The rows since the last call."""
        news, self._news = self._news, []
        return news
