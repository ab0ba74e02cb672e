"""Where the odometry's frame lies on the map: from seldom poses on the map and frequent odometry."""

import math
from bisect import bisect_left
from collections import deque

from adrl.deploy.messages import Odometry, Pose
from adrl.geometry import compose, inverse, part_way

KEPT = 200
"""Odometry messages that are remembered: poses on the map are older than odometry."""
GAP_S = 1.0
"""Stamps farther apart are of a clock that has jumped, or of another clock."""


class Localisation:
    """The transform from the odometry's frame to the map's, as map -> odom is in ROS (REP 105)."""

    def __init__(self) -> None:
        self._history: deque[Odometry] = deque(maxlen=KEPT)
        self._odom_on_map: Pose | None = None

    @property
    def known(self) -> bool:
        """Whether any pose on the map has come since the odometry began."""
        return self._odom_on_map is not None

    @property
    def newest(self) -> Odometry | None:
        """The last odometry."""
        return self._history[-1] if self._history else None

    def forget(self) -> None:
        """The odometry begins anew: what was known of its frame holds no longer."""
        self._odom_on_map = None
        self._history.clear()

    def forget_stamps(self) -> None:
        """The clock has gone back: odometry is stamped anew, its frame is where it was."""
        self._history.clear()

    def place(self, odom_on_map: Pose | None) -> None:
        """Where the odometry's frame is on the map, as a tree of transforms tells; None where it does not."""
        self._odom_on_map = odom_on_map

    def take_odometry(self, odometry: Odometry) -> None:
        """Remember it, unless it is overtaken by a newer one; after a clock has jumped, it alone."""
        if not math.isfinite(odometry.stamp_s) or not all(map(math.isfinite, odometry.pose)):
            return
        if self._history and abs(odometry.stamp_s - self._history[-1].stamp_s) > GAP_S:
            self._history.clear()
        if not self._history or odometry.stamp_s > self._history[-1].stamp_s:
            self._history.append(odometry)

    def take_pose(self, on_map: Pose, stamp_s: float) -> bool:
        """Where the robot was on the map at stamp_s.

        False when it is of no use: not finite, no odometry of that time. The first may be of long ago: localisation
        reports again once the robot moves.
        """
        if not all(map(math.isfinite, (*on_map, stamp_s))) or not self._history:
            return False
        before = stamp_s < self._history[0].stamp_s
        if stamp_s > self._history[-1].stamp_s + GAP_S or (before and self.known):
            return False
        self._odom_on_map = compose(on_map, inverse(self._pose_at(stamp_s)))
        return True

    def to_map(self, pose: Pose) -> Pose:
        """A pose in the odometry's frame, on the map. Needs a known one."""
        assert self._odom_on_map is not None
        return compose(self._odom_on_map, pose)

    def to_odom(self, pose: Pose) -> Pose:
        """The inverse of to_map."""
        assert self._odom_on_map is not None
        return compose(inverse(self._odom_on_map), pose)

    def _pose_at(self, stamp_s: float) -> Pose:
        """By odometry; beyond what is remembered, the nearest."""
        known = self._history
        later = bisect_left(known, stamp_s, key=lambda message: message.stamp_s)
        if later == 0 or later == len(known):
            return known[min(later, len(known) - 1)].pose
        before, after = known[later - 1], known[later]
        share = (stamp_s - before.stamp_s) / (after.stamp_s - before.stamp_s)
        return part_way(before.pose, after.pose, share)
