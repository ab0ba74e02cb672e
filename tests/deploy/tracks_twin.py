"""The slow twin of the kernel that follows what moves, scan by scan, cluster by cluster."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from adrl.deploy.lidar import beam_towards, readings, sees_all_round
from adrl.deploy.messages import Pose, Scan
from adrl.geometry import in_robot_frame
from adrl.types import Array

Mask = NDArray[np.bool_]

PEOPLE_MPS = 2.0
JOINED_M, JOINED_BEAMS = 0.2, 2.5
PERSON_M, BESIDE = 0.6, 4
WIDEST_M = 1.0
LOST_S = 0.5
OVER_S, LEAST_S = 0.4, 0.15
SLACK_M = 0.1
FREE_M = 0.08
SLOWEST_MPS = 0.15
STOPS_S = 0.5
SURE = 3
ROUNDING_S = 1e-6


@dataclass
class Track:
    """One cluster, as long as it is seen."""

    places: deque[tuple[float, float, float]]
    """(stamp_s, x, y) of the last OVER_S, the newest last."""
    velocity: tuple[float, float] = (0.0, 0.0)
    moved_s: float = -math.inf
    """When it was last seen to move."""
    moved: int = 0
    """Scans in which it was."""


@dataclass
class _Past:
    stamp_s: float
    sensor: Pose
    scan: Scan
    free_m: Array = field(repr=False)
    """(K,) so far three beams in a row have seen nothing; 0 where one of them tells nothing."""


class SlowTracks:
    """As adrl.deploy.tracks.Tracks."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """The odometry's frame is another now."""
        self.tracks: list[Track] = []
        self._lost: list[Track] = []
        self._past: deque[_Past] = deque()

    def take(self, scan: Scan, sensor: Pose, hit: Mask, points: Array) -> tuple[Array, Array]:
        """(H, 2) velocities and (H,) breadths of what has moved."""
        now_s = scan.stamp_s
        if self._past and now_s <= self._past[-1].stamp_s:
            self.forget()
        came = self._came(points)
        velocities, breadths = np.zeros((len(points), 2)), np.full(len(points), np.inf)
        before, self.tracks = [*self._lost, *self.tracks], []
        for members in _clusters(scan, hit, points):
            x, y = points[members].mean(axis=0).tolist()
            track = self._follow(before, x, y, now_s)
            self.tracks.append(track)
            _measure(track, bool(came[members].mean() > 0.2))
            if now_s - track.moved_s <= STOPS_S:
                velocities[members] = track.velocity
            if track.moved >= SURE:
                breadths[members] = np.hypot(*np.ptp(points[members], axis=0))
        self._lost = [track for track in before if track.places[-1][0] >= now_s - LOST_S - ROUNDING_S]
        ranges, told = readings(scan)
        seen = np.where(told, np.minimum(ranges, scan.range_max_m), 0.0)
        free_m = np.minimum(np.minimum(np.roll(seen, 1), np.roll(seen, -1)), seen)
        if not sees_all_round(scan):
            free_m[[0, -1]] = 0.0
        self._past.append(_Past(now_s, sensor, scan, free_m))
        while self._past[0].stamp_s < now_s - OVER_S - ROUNDING_S:
            self._past.popleft()
        return velocities, breadths

    def _came(self, points: Array) -> Mask:
        """(H,) which points lie where one of the scans of a while ago saw free space."""
        came = np.zeros(len(points), dtype=bool)
        for past in self._past:
            x, y = in_robot_frame(np.array(past.sensor), points).T
            beam = beam_towards(past.scan, np.arctan2(y, x))
            came |= (beam >= 0) & (past.free_m[np.maximum(beam, 0)] > np.hypot(x, y) + FREE_M)
        return came

    def _follow(self, before: list[Track], x: float, y: float, now_s: float) -> Track:
        """The track of before that is nearest to where it is expected, taken out of the list; else a new one."""
        nearest, least = None, math.inf
        for track in before:
            at_s, at_x, at_y = track.places[-1]
            passed_s = now_s - at_s
            vx, vy = track.velocity
            off = math.hypot(at_x + vx * passed_s - x, at_y + vy * passed_s - y)
            known = track.velocity != (0.0, 0.0)
            if off < least and off < (0.5 if known else 1.0) * PEOPLE_MPS * passed_s + SLACK_M:
                nearest, least = track, off
        if nearest is None:
            return Track(deque([(now_s, x, y)]))
        before.remove(nearest)
        nearest.places.append((now_s, x, y))
        while nearest.places[0][0] < now_s - OVER_S - ROUNDING_S:
            nearest.places.popleft()
        return nearest


def _measure(track: Track, came: bool) -> None:
    """Its velocity by the line through its places. came: hits of it lie where there was nothing."""
    places = np.array(track.places)
    since_s = places[:, 0] - places[-1, 0]
    if -since_s[0] < LEAST_S:
        return
    off_s = since_s - since_s.mean()
    vx, vy = off_s @ places[:, 1:] / (off_s @ off_s)
    speed = math.hypot(vx, vy)
    most = PEOPLE_MPS / max(speed, PEOPLE_MPS)
    track.velocity = (float(vx) * most, float(vy) * most)
    if came and speed > SLOWEST_MPS:
        track.moved_s = float(places[-1, 0])
        track.moved += 1


def _clusters(scan: Scan, hit: Mask, points: Array) -> list[NDArray[np.intp]]:
    """Numbers of the points of each cluster; walls are none."""
    if len(points) == 0:
        return []
    numbers = np.flatnonzero(hit)
    circle = 2.0 * math.pi / abs(scan.angle_increment_rad)
    away = np.hypot(*np.diff(points, axis=0, append=points[:1]).T)
    turned = np.diff(numbers, append=numbers[0] + circle)
    split = (away > JOINED_M) | (turned > JOINED_BEAMS)
    if not split.any():
        return []  # a wall all round
    # Round the full circle the last hit may be beside the first one: begin behind a gap.
    first = (int(np.flatnonzero(split)[-1]) + 1) % len(points)
    order = np.roll(np.arange(len(points)), -first)
    ends = np.flatnonzero(split[order]) + 1
    pieces = np.split(order, ends[:-1])
    found: list[NDArray[np.intp]] = []
    for piece in pieces:
        if np.hypot(*np.ptp(points[piece], axis=0)) >= WIDEST_M:
            continue
        for c in range(len(found) - 1, max(len(found) - BESIDE, -1), -1):
            whole = np.concatenate([found[c], piece])
            if np.hypot(*np.ptp(points[whole], axis=0)) < PERSON_M:
                found[c] = whole
                break
        else:
            found.append(piece)
    return found
