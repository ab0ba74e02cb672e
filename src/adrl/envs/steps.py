"""What steps of a simulator's robots bring, as the reward sees them."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adrl.envs.kinds import KindRows, Mask, agreed, chosen
from adrl.geometry import wrapped
from adrl.observation import in_robot_frame
from adrl.rewards import RewardConfig, Step, features, terms
from adrl.rewards.terms import STAGNATION_WINDOW
from adrl.types import Array

if TYPE_CHECKING:
    from adrl.envs.nav_sim import NavSim

F32 = NDArray[np.float32]
Rows = NDArray[np.intp] | slice
ALL = slice(None)


@dataclass(frozen=True)
class Outcome:
    """What one step brought, a row a robot."""

    reached: Mask
    collided: Mask
    timed_out: Mask
    reward_terms: F32
    """(N, R) r_i of eqs 7-12."""
    features: F32
    """(N, F) features of the state in which the action was taken."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Before:
    """Where robots were when a step began, (N, ...)."""

    pose: Array
    guided: Array
    """Their poses in the frame of the waypoints."""
    waypoint: Array
    distance_m: Array


class Steps:
    """Measures each step of a simulator: before(), then outcome(), then see() what the next one begins with."""

    def __init__(self, sim: "NavSim", kinds: KindRows, reward: RewardConfig) -> None:
        """kinds: those that a row may be."""
        self._sim, self._reward = sim, reward
        self._on_map, self._led = agreed(kinds.on_map), agreed(kinds.led)
        self._displacements = np.zeros((sim.num_envs, STAGNATION_WINDOW))
        self._features = np.zeros((sim.num_envs, len(reward.features())), dtype=np.float32)
        self._quantities = reward.quantities()

    def begin(self, rows: NDArray[np.intp]) -> None:
        """Robots `rows` (M,) stand at their starts. They are not stagnant: their window begins full."""
        own = self._sim.rows.robot[rows]
        self._displacements[rows] = (own.max_speed_mps * own.control_period_s)[:, None]
        self._features[rows] = features(self._snapshot(rows), self._reward)

    def before(self) -> Before:
        """A step is about to be made."""
        b = self._sim.b
        return Before(
            pose=b["pose"].copy(),
            guided=self._guided_pose().copy(),
            waypoint=b["waypoint"].copy(),
            distance_m=self._distance(),
        )

    def outcome(self, before: Before, time_limit_s: Array) -> tuple[Outcome, Step]:
        """A step has been made. time_limit_s: (N,)"""
        b = self._sim.b
        moved = np.hypot(*(b["pose"][:, :2] - before.pose[:, :2]).T)
        self._displacements[:, :-1] = self._displacements[:, 1:]
        self._displacements[:, -1] = moved
        reached, collided = b["reached"].astype(bool), b["collided"].astype(bool)
        timed_out = (b["time"] >= time_limit_s - 1e-6) & ~reached & ~collided
        step = self._snapshot(
            reached=reached,
            collided=collided,
            timed_out=timed_out,
            displacement_m=moved,
            turn_rad=wrapped(b["pose"][:, 2] - before.pose[:, 2]),
            coordinate_distance_m=self._coordinate_distance(),
            previous_distance_m=before.distance_m,
            heading_error_rad=_heading_error(self._guided_pose(), before.waypoint),
            previous_heading_error_rad=_heading_error(before.guided, before.waypoint),
        )
        outcome = Outcome(
            reached=reached,
            collided=collided,
            timed_out=timed_out,
            reward_terms=terms(step, self._reward),
            features=self._features,
        )
        return outcome, step

    def see(self, step: Step, *, waypoints_moved: bool) -> None:
        """The features of the state in which the next action is taken. waypoints_moved: after the step."""
        if waypoints_moved:
            step = dataclasses.replace(step, distance_m=self._distance())
        self._features = features(step, self._reward)

    def state(self) -> dict[str, NDArray[Any]]:
        """All that changes."""
        return {"displacements": self._displacements, "features": self._features}

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a copy of what state() returned."""
        self._displacements, self._features = (state[name].copy() for name in ("displacements", "features"))

    def _distance(self, rows: Rows = ALL) -> Array:
        """(N,) metres to the goal: straight, or along the path for guidance `map`.

        For `replan` straight to the waypoint and from there along the robot's own route, which no step changes.
        """
        sim = self._sim
        straight = np.hypot(*(sim.b["waypoint"][rows] - self._guided_pose()[rows, :2]).T)
        if sim.replanner is not None:
            straight += sim.replanner.beyond_m[rows]
        return chosen(self._on_map, sim.rows.on_map[rows], sim.b["route_left"][rows], straight).copy()

    def _guided_pose(self) -> Array:
        """(N, 3) poses in the frame that waypoints are given in: replanned ones are in the odometry's."""
        b = self._sim.b
        return chosen(self._led, self._sim.rows.led, b["odometry"], b["pose"])

    def _coordinate_distance(self) -> Array:
        """(N,) metres from the robot's centre to the nearest obstacle's coordinates, for the literal eq 8.

        Looked up for that form only, for every active robot: d_r is the circumscribed radius, and an obstacle beside
        a long robot may have its middle nearer than that without contact.
        """
        sim = self._sim
        distance = np.full(sim.num_envs, np.inf)
        if self._reward.eq8 == "literal":
            for i in np.flatnonzero(sim.b["active"]):
                task = sim.tasks[i]
                assert task is not None
                points = [task.world.coordinates(float(sim.b["time"][i])), sim.people(int(i))[:, :2]]
                offsets = np.concatenate(points) - sim.b["pose"][i, :2]
                distance[i] = np.hypot(*offsets.T).min(initial=np.inf)
        return distance

    def _snapshot(self, rows: Rows = ALL, **changes: Any) -> Step:
        """The current state of robots as the reward sees it; without changes, one in which nothing has moved."""
        sim = self._sim
        distance, b, robots = self._distance(rows), sim.b, sim.rows.robot
        n = len(distance)
        if "heading_error_rad" not in changes:
            error = _heading_error(self._guided_pose()[rows], b["waypoint"][rows])
            changes |= {"heading_error_rad": error, "previous_heading_error_rad": error}
        values: dict[str, Any] = {
            "reached": np.zeros(n, dtype=bool),
            "collided": np.zeros(n, dtype=bool),
            "timed_out": np.zeros(n, dtype=bool),
            "speed_mps": b["twist"][rows, 0],
            "yaw_rate_radps": b["twist"][rows, 1],
            "distance_m": distance,
            "previous_distance_m": distance,
            "clearance_m": b["clearance"][rows],
            "mean_displacement_m": self._displacements[rows].mean(axis=1),
            "displacement_m": np.zeros(n),
            "turn_rad": np.zeros(n),
            "coordinate_distance_m": np.full(n, np.inf),
            "contact_m": robots.circumscribed_radius_m[rows],
            "max_speed_mps": robots.max_speed_mps[rows],
            "max_yaw_rate_radps": robots.max_yaw_rate_radps[rows],
            "dt_s": robots.control_period_s[rows],
            "quantities": {name: quantity(sim)[rows] for name, quantity in self._quantities.items()},
        }
        return Step(**(values | changes))


def _heading_error(pose: Array, target: Array) -> Array:
    """(N,) angle from the heading to the target, in (-pi, pi]."""
    ahead = in_robot_frame(pose, target)
    return np.arctan2(ahead[:, 1], ahead[:, 0])
