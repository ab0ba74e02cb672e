"""Goals of a recording, and where they lie for the robot's own reckoning."""

import math
from dataclasses import dataclass

import numpy as np

from adrl.bags import Bag
from adrl.bags.odometry import OdometryTable, ordered, stamp_of
from adrl.bags.reader import GOALS, POSES
from adrl.bags.transforms import Chain, Transforms, frame_name
from adrl.errors import DatasetError
from adrl.geometry import compose, inverse, quaternion_of, yaw_of
from adrl.types import Array

GOAL_TOPICS = ("/goal_pose", "/move_base_simple/goal")
"""Where RViz sends goals, in ROS 2 and in ROS 1."""
SAME_GOAL_M = 0.01
"""A goal that is sent again is no new goal."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Goals:
    """G goals in order of time, each in the frame that it was given in."""

    times_s: Array
    """(G,) when the bag recorded them."""
    places: Array
    """(G, 2)."""
    chains: tuple[Chain | None, ...]
    """Of each, its frame in the odometry's; None where it is the same."""

    def at(self, number: int, times_s: Array) -> Array:
        """(T, 2) where a goal lies in the odometry's frame.

        A goal on the map stays there: it moves for the odometry as localisation finds out how that has drifted. A goal
        that was given from where the robot was stays where that was.
        """
        chain, place = self.chains[number], self.places[number]
        if chain is None:
            return np.tile(place, (len(times_s), 1))
        if chain.links[0].forward:  # a frame of the robot
            times_s = np.full(len(times_s), self.times_s[number])
        origin, turn = chain.at(times_s)
        return (origin + turn.apply([*place, 0.0]))[:, :2]


def read_goals(
    bag: Bag, topic: str | None, pose_topic: str, transforms: Transforms, odometry: OdometryTable
) -> Goals | None:
    """Each goal once; None for a bag without goals. Where /tf does not relate their frame to the odometry's,
    poses on the map (pose_topic) do.

    Raises DatasetError: see Bag.messages; a frame that nothing relates to the odometry's; numbers that are not finite.
    """
    if topic is None:  # a topic that RViz alone has announced is empty
        topic = next((name for name in GOAL_TOPICS if any(bag.messages(name, GOALS, optional=True))), None)
    if topic is None:
        return None
    rows: list[tuple[float, float, float]] = []
    frames: list[str] = []
    for seconds, message in bag.messages(topic, GOALS):
        frame, at = frame_name(message.header.frame_id), message.pose.position
        if rows and frame == frames[-1] and math.hypot(at.x - rows[-1][1], at.y - rows[-1][2]) <= SAME_GOAL_M:
            continue
        rows.append((seconds, at.x, at.y))
        frames.append(frame)
    order = np.argsort([row[0] for row in rows], kind="stable")
    table = ordered(bag.path, topic, rows)
    chains = {
        frame: _chain(bag, topic, frame, pose_topic, transforms, odometry)
        for frame in dict.fromkeys(frames)
        if frame != odometry.frame
    }
    return Goals(times_s=table[:, 0], places=table[:, 1:], chains=tuple(chains.get(frames[i]) for i in order))


def _chain(
    bag: Bag, topic: str, frame: str, pose_topic: str, transforms: Transforms, odometry: OdometryTable
) -> Chain:
    """A goal's frame in the odometry's."""
    chain = transforms.chain(odometry.frame, frame) or _localised(bag, pose_topic, odometry).chain(
        odometry.frame, frame
    )
    if chain is None:
        raise DatasetError(
            f"{bag.path}: {topic} is in frame {frame!r}, odometry in {odometry.frame!r}, and neither /tf nor "
            f"{pose_topic} relates them; record /tf, or send goals in {odometry.frame!r}"
        )
    return chain


def _localised(bag: Bag, pose_topic: str, odometry: OdometryTable) -> Transforms:
    """The odometry's frame on the map, from poses of the robot on the map (REP 105: map -> odom)."""
    transforms = Transforms()
    for seconds, message in bag.messages(pose_topic, POSES, optional=True):
        pose = message.pose.pose
        on_map = (pose.position.x, pose.position.y, yaw_of(pose.orientation))
        when_s = odometry.recorded(stamp_of(message.header), seconds)
        x, y, yaw = compose(on_map, inverse(odometry.poses(np.array([when_s]))[0]))
        try:
            transforms.add(
                frame_name(message.header.frame_id), odometry.frame, seconds, (x, y, 0.0), quaternion_of(yaw)
            )
        except ValueError:
            raise DatasetError(
                f"{bag.path}: {pose_topic} holds a number that is not finite, or an orientation that is none"
            ) from None
    return transforms
