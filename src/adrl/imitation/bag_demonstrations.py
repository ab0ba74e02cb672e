"""Demonstrations from a robot that somebody drove: bags of scans, odometry, commands and goals."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError, DatasetError
from adrl.geometry import nearest_on_segments
from adrl.imitation.bag_recording import BagTopics, Recording, read_recording
from adrl.imitation.demonstrations import Demonstrations
from adrl.observation import EncoderConfig, ObservationEncoder, in_robot_frame, to_action
from adrl.observation.motion import ScanHistory
from adrl.observation.path_ahead import PATH_POINTS_M
from adrl.rewards import RewardConfig, Step, features, terms
from adrl.rewards.terms import STAGNATION_WINDOW
from adrl.types import GOAL_TOLERANCE_M, Array, RobotConfig

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

STANDING = (0.02, 0.05)
"""Speed in m/s and yaw rate in rad/s up to which a robot that is told no more stands."""
PAUSE_S = 2.0
"""A robot that stands for so long has made a pause: an episode ends before it, and another begins after it."""


@dataclass(frozen=True, kw_only=True)
class BagSummary:
    """What became of a bag."""

    episodes: int
    arrivals: int
    """Episodes that reached their goal."""
    recorded_s: float
    used_s: float
    """Time in the episodes; the rest is standing, silence, driving without a goal or after an arrival."""
    goals_from_topic: bool
    """Else goals are where the robot came to stand."""
    clipped: float
    """Fraction of the commands that are beyond the robot's speeds."""
    notes: tuple[str, ...]
    """What was decided about data that contradict each other or the robot."""


def read_demonstrations(
    paths: Sequence[str | os.PathLike[str]],
    robot: RobotConfig,
    *,
    encoder: EncoderConfig | None = None,
    topics: BagTopics | None = None,
    zero_is_free: bool = False,
    nan_is_free: bool = False,
    goal_tolerance_m: float = GOAL_TOLERANCE_M,
) -> tuple[Demonstrations, list[BagSummary]]:
    """Demonstrations for guidance `goal` from bags of ROS 1 or ROS 2, and a summary of each.

    An action is the newest command when a control period begins, or within half a period after; so is the expert's.
    An episode is what was driven without a pause to one goal, and ends on arrival, terminated; else it is truncated.
    Rewards and features are those of the simulator, with what the robot knows: its odometry for its motion, and the
    distance from its footprint to its scan for the clearance. A collision cannot be told from a near miss: the failure
    term is 0. zero_is_free, nan_is_free: see read_recording. Raises MissingExtra, ConfigError for no
    paths, DatasetError.
    """
    if not paths:
        raise ConfigError("no bags; give one or more")
    parts, summaries = [], []
    for path in map(Path, paths):
        recording = read_recording(
            path, robot, topics or BagTopics(), zero_is_free=zero_is_free, nan_is_free=nan_is_free
        )
        try:
            drives = _drives(recording, robot, goal_tolerance_m)
        except DatasetError as error:
            raise DatasetError("; ".join([f"{path}: {error}", *recording.notes])) from None
        parts += [_demonstrations(recording, drive, robot, encoder) for drive in drives]
        summaries.append(_summary(recording, drives, robot))
    joined = {f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Demonstrations)}
    return Demonstrations(**joined), summaries


@dataclass(frozen=True, kw_only=True)
class _Drive:
    """One episode: the steps first to last - 1, from their instants to the next ones."""

    first: int
    last: int
    goal: Array
    """(T + 1, 2) where it lies at each state."""
    reached: bool


def _drives(recording: Recording, robot: RobotConfig, tolerance_m: float) -> list[_Drive]:
    """The episodes of a recording. Raises DatasetError for none, saying why."""
    standing = _still(recording.twist)
    idle = standing & _still(recording.command)
    idle_steps = idle[:-1] & recording.joined
    wanted = recording.joined & _without_pauses(
        idle_steps, math.ceil(PAUSE_S / robot.control_period_s - 1e-9)
    )
    if not (wanted & ~idle_steps).any():
        raise DatasetError(
            f"no movement: the robot stands for all of its {len(idle) * robot.control_period_s:.1f} s; "
            "give a bag in which it drives"
        )
    if recording.goals is not None:
        wanted &= recording.goal[:-1] >= 0
    drives = []
    for first, last in _runs(wanted, recording.goal[:-1]):
        driven = np.flatnonzero(~idle_steps[first:last])
        if len(driven) == 0:
            continue
        # Nothing is learnt from waiting for somebody to begin.
        first, last = first + int(driven[0]), first + int(driven[-1]) + 1
        if recording.goals is not None:
            goal = recording.goals.at(int(recording.goal[first]), recording.times_s[first : last + 1])
        elif standing[last]:
            goal = np.tile(recording.pose[last, :2], (last + 1 - first, 1))
        else:
            continue
        places = recording.pose[first : last + 1, :2] - goal
        # The goal's disc may be crossed in a step.
        nearest = nearest_on_segments(places[:-1], places[1:], np.zeros(2))
        near = np.flatnonzero(np.hypot(*nearest.T) < tolerance_m)
        if len(near) > 0:
            last = first + int(near[0]) + 1
            goal = goal[: last + 1 - first]
        if np.hypot(*places[0]) >= tolerance_m:
            drives.append(_Drive(first=first, last=last, goal=goal, reached=len(near) > 0))
    if not drives:
        lacking = (
            f"none comes to a stand farther than {tolerance_m} m from where it began; send goals, or stop at them"
            if recording.goals is None
            else f"none has a goal farther than {tolerance_m} m; send the goal before the robot drives off"
        )
        raise DatasetError(f"no episode in the drives: {lacking}")
    return drives


def _still(twists: Array) -> Mask:
    """(M,) whether speed and yaw rate (M, 2) are no more than STANDING."""
    return (np.abs(twists[:, 0]) <= STANDING[0]) & (np.abs(twists[:, 1]) <= STANDING[1])


def _without_pauses(idle: Mask, least: int) -> Mask:
    """(M,) steps that are not of a run of `least` idle ones."""
    moving = np.ones(len(idle), dtype=bool)
    for first, last in _runs(idle, np.zeros(len(idle))):
        moving[first:last] = last - first < least
    return moving


def _runs(wanted: Mask, label: NDArray[np.generic]) -> list[tuple[int, int]]:
    """(first, last + 1) of the runs of wanted steps with one label."""
    changes = np.flatnonzero((np.diff(wanted.astype(np.int8)) != 0) | (np.diff(label) != 0)) + 1
    edges = [0, *changes.tolist(), len(wanted)]
    return [(a, b) for a, b in pairwise(edges) if b > a and wanted[a]]


def _demonstrations(
    recording: Recording, drive: _Drive, robot: RobotConfig, encoder: EncoderConfig | None
) -> Demonstrations:
    """T steps of an episode: as NavSim would have them, for guidance `goal`."""
    first, last = drive.first, drive.last
    under_way = first > 0 and recording.joined[first - 1]
    before = recording.command[first - 1] if under_way else np.zeros(2)
    told = to_action(np.concatenate([[before], recording.command[first:last]]), robot)  # (T + 1, 2)
    states = slice(first, last + 1)
    pose, ranges, twist = recording.pose[states], recording.ranges[states], recording.twist[states]
    goal = in_robot_frame(pose, drive.goal)
    code = ObservationEncoder(robot, encoder)
    path = np.repeat(goal[:, None], len(PATH_POINTS_M), axis=1)
    seen = code.encode(ranges, goal, twist, told, _history(ranges, pose, code.history_steps), path)
    ended = np.arange(first, last) == last - 1
    reached = ended & drive.reached
    distance, heading = np.hypot(*goal.T), np.arctan2(goal[:, 1], goal[:, 0])
    moved = np.hypot(*np.diff(pose[:, :2], axis=0).T)
    longest_m = robot.max_speed_mps * robot.control_period_s
    # A robot that has just started is not stagnant: its window begins full.
    displacements = np.concatenate([np.full(STAGNATION_WINDOW, longest_m), moved])
    mean = np.lib.stride_tricks.sliding_window_view(displacements, STAGNATION_WINDOW).mean(axis=1)
    clearance = scan_clearance(ranges, robot)
    nothing = np.zeros(len(moved), dtype=bool)
    step = Step(
        reached=reached,
        collided=nothing,
        timed_out=nothing,
        speed_mps=twist[1:, 0],
        yaw_rate_radps=twist[1:, 1],
        distance_m=distance[1:],
        previous_distance_m=distance[:-1],
        heading_error_rad=heading[1:],
        previous_heading_error_rad=heading[:-1],
        clearance_m=clearance[1:],
        mean_displacement_m=mean[1:],
        displacement_m=moved,
        turn_rad=np.diff(pose[:, 2]),
        coordinate_distance_m=np.full(len(moved), np.inf),
        contact_m=robot.circumscribed_radius_m,
        max_speed_mps=robot.max_speed_mps,
        max_yaw_rate_radps=robot.max_yaw_rate_radps,
        dt_s=robot.control_period_s,
    )
    taken_from = replace(
        step, distance_m=distance[:-1], clearance_m=clearance[:-1], mean_displacement_m=mean[:-1]
    )
    return Demonstrations(
        observation=seen[:-1],
        next_observation=seen[1:],
        action=told[1:],
        expert_action=told[1:],
        reward_terms=terms(step, RewardConfig()),
        features=features(taken_from, RewardConfig()),
        terminated=reached,
        truncated=ended & ~reached,
        periods=np.broadcast_to(step.periods, len(moved)),
    )


def _history(ranges: F32, pose: Array, steps: int) -> ScanHistory | None:
    """Of each state, the scans of so many control periods; before the episode's first there is that one."""
    if steps == 0:
        return None
    rows = np.arange(len(ranges))
    history = ScanHistory(len(ranges), ranges.shape[1], steps)
    for ago in range(steps, -1, -1):
        past = np.maximum(rows - ago, 0)
        history.add(ranges[past], pose[past])
    return history


def scan_clearance(ranges: F32, robot: RobotConfig) -> Array:
    """(N,) distance from the footprint's edge to what scans (N, K) have hit; the greatest range where nothing was.

    What lies inside of the footprint is the robot itself, or noise, and is passed over.
    """
    lidar = robot.lidar
    angles = lidar.angles_rad + lidar.mount_yaw_rad
    x, y = lidar.mount_x_m + ranges * np.cos(angles), lidar.mount_y_m + ranges * np.sin(angles)  # (N, K)
    if robot.radius_m is not None:
        distance = np.hypot(x, y) - robot.radius_m
    else:
        distance = np.full(x.shape, np.inf)
        corners = robot.polygon
        for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            ex, ey = bx - ax, by - ay
            share = np.clip((ex * (x - ax) + ey * (y - ay)) / (ex * ex + ey * ey), 0.0, 1.0)
            distance = np.minimum(distance, np.hypot(x - ax - share * ex, y - ay - share * ey))
    free = ranges >= np.float32(lidar.max_range_m)
    own = robot.covers(np.stack([x, y], axis=-1, dtype=np.float64))
    return np.where(free | own, lidar.max_range_m, distance).min(axis=1)


def _summary(recording: Recording, drives: list[_Drive], robot: RobotConfig) -> BagSummary:
    used = np.concatenate([np.arange(drive.first, drive.last) for drive in drives])
    high = np.array([robot.max_speed_mps, robot.max_yaw_rate_radps])
    low = np.array([robot.min_speed_mps, -robot.max_yaw_rate_radps])
    beyond = (recording.command[used] > high + 1e-6) | (recording.command[used] < low - 1e-6)
    return BagSummary(
        episodes=len(drives),
        arrivals=sum(drive.reached for drive in drives),
        recorded_s=len(recording.pose) * robot.control_period_s,
        used_s=len(used) * robot.control_period_s,
        goals_from_topic=recording.goals is not None,
        clipped=float(beyond.any(axis=1).mean()),
        notes=recording.notes,
    )
