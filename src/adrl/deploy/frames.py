"""Where one frame is in another, by what /tf and /tf_static have told: a buffer as tf2's, without any middleware.

frames = Frames(tolerance_s=0.5)
frames.take("map", "odom", stamp_s, (x, y, z), (qx, qy, qz, qw))
planar(frames.lookup("map", "odom", stamp_s))       # (x, y, yaw) of odom in map, at that moment
"""

import logging
import math
from bisect import bisect_left, bisect_right, insort
from dataclasses import dataclass, field

import numpy as np

from adrl.deploy.messages import Pose
from adrl.errors import TransformError
from adrl.geometry import Array, level_mount

LOG = logging.getLogger("adrl.driver")

KEPT_S = 10.0
"""Of each transform so much is remembered, as tf2 does. Stamps that go back by more are of a clock that began anew."""
NEAR = 0.9995
"""Cosine of half the angle between two rotations from which on the straight line between them is as good."""

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""


@dataclass(frozen=True)
class Transform:
    """A frame in another one."""

    place: Vector
    turn: Quaternion


IDENTITY = Transform((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def compose(a: Transform, b: Transform) -> Transform:
    """b, given in the frame a, in the frame that a is given in."""
    x, y, z = _rotated(a.turn, b.place)
    return Transform((a.place[0] + x, a.place[1] + y, a.place[2] + z), _product(a.turn, b.turn))


def inverse(a: Transform) -> Transform:
    """compose(a, inverse(a)) is the identity."""
    x, y, z, w = a.turn
    back = (-x, -y, -z, w)
    x, y, z = _rotated(back, a.place)
    return Transform((-x, -y, -z), back)


def between(a: Transform, b: Transform, share: float) -> Transform:
    """At a share of the way from a to b: places on the straight line, rotations on the great circle (slerp)."""
    px, py, pz = (p + share * (q - p) for p, q in zip(a.place, b.place, strict=True))
    cosine = sum(p * q for p, q in zip(a.turn, b.turn, strict=True))
    sign = -1.0 if cosine < 0.0 else 1.0  # q and -q are one rotation: the shorter way round
    near, far = 1.0 - share, sign * share
    if abs(cosine) < NEAR:
        angle = math.acos(abs(cosine))
        near, far = (
            math.sin(near * angle) / math.sin(angle),
            sign * math.sin(share * angle) / math.sin(angle),
        )
    x, y, z, w = (near * p + far * q for p, q in zip(a.turn, b.turn, strict=True))
    return Transform((px, py, pz), _unit((x, y, z, w)))


def planar(transform: Transform) -> Pose:
    """x, y and yaw; what is tilted is looked at from above."""
    ahead = _rotated(transform.turn, (1.0, 0.0, 0.0))
    return transform.place[0], transform.place[1], math.atan2(ahead[1], ahead[0])


def matrix(transform: Transform) -> tuple[Array, Array]:
    """(3, 3) the frame's axes as columns, and (3,) its place: axes @ point + place is the point in the other frame."""
    axes = np.array([_rotated(transform.turn, axis) for axis in np.eye(3).tolist()]).T
    return axes, np.array(transform.place)


def mount_of(transform: Transform) -> tuple[Pose, bool]:
    """Where a LiDAR of that frame sits on its robot, and whether upside down. Raises TransformError if tilted."""
    axes, place = matrix(transform)
    try:
        return level_mount(place, axes)
    except ValueError as error:
        raise TransformError(f"the LiDAR {error}; mend its transform, or mount it level") from None


@dataclass(eq=False)
class _Link:
    """A frame in its parent, over the last seconds."""

    parent: str
    static: bool
    stamps_s: list[float] = field(default_factory=list)
    told: list[Transform] = field(default_factory=list)

    def put(self, stamp_s: float, transform: Transform) -> None:
        if self.static or (self.stamps_s and stamp_s < self.stamps_s[-1] - KEPT_S):
            self.stamps_s.clear()
            self.told.clear()
        at = bisect_left(self.stamps_s, stamp_s)
        if at < len(self.stamps_s) and self.stamps_s[at] == stamp_s:
            self.told[at] = transform
        else:
            insort(self.stamps_s, stamp_s)
            self.told.insert(at, transform)
        old = bisect_left(self.stamps_s, self.stamps_s[-1] - KEPT_S)
        del self.stamps_s[:old], self.told[:old]


class Frames:
    """A tree of frames: each has one parent. What cannot be is passed over, and the log says so once."""

    def __init__(self, *, tolerance_s: float = 0.5) -> None:
        """tolerance_s: the newest transform still holds so long after its stamp; Nav2's transform_tolerance."""
        self._tolerance_s = tolerance_s
        self._links: dict[str, _Link] = {}
        """Child -> where it is in its parent."""
        self._passed_over: set[tuple[str, str]] = set()

    def take(
        self,
        parent: str,
        child: str,
        stamp_s: float,
        place: Vector,
        turn: Quaternion,
        *,
        static: bool = False,
    ) -> None:
        """The child in its parent, at stamp_s; static: at all times."""
        parent, child = parent.strip("/"), child.strip("/")
        square = sum(part * part for part in turn)
        if not (all(map(math.isfinite, (stamp_s, *place, *turn))) and 0.5 < square < 2.0 and parent != child):
            if (parent, child) not in self._passed_over:
                self._passed_over.add((parent, child))
                LOG.warning(
                    "transform %r -> %r cannot be: %s, %s; it is passed over: mend who sends it",
                    *(parent, child, place, turn),
                )
            return
        link = self._links.get(child)
        if link is None or (link.parent, link.static) != (parent, static):
            link = self._links[child] = _Link(parent, static)
        link.put(stamp_s, Transform(place, _unit(turn)))

    def forget(self) -> None:
        """The odometry or the clock has begun anew: what moves is to be told again."""
        self._links = {child: link for child, link in self._links.items() if link.static}

    def lookup(self, target: str, source: str, stamp_s: float) -> Transform:
        """The source frame in the target frame, at stamp_s: between the two transforms told nearest to it.

        Raises TransformError where one is missing, stale or of the future.
        """
        target, source = target.strip("/"), source.strip("/")
        up, down = self._ancestors(target), self._ancestors(source)
        common = next((frame for frame in down if frame in up), None)
        if common is None:
            raise TransformError(self._missing(target, source))
        from_source = self._climb(down[: down.index(common)], stamp_s)
        from_target = self._climb(up[: up.index(common)], stamp_s)
        return compose(inverse(from_target), from_source)

    def _climb(self, frames: list[str], stamp_s: float) -> Transform:
        """The first of some frames, each the child of the next, in the last one's parent."""
        out = IDENTITY
        for frame in frames:
            out = compose(self._at(frame, stamp_s), out)
        return out

    def _ancestors(self, frame: str) -> list[str]:
        """It, its parent and so on. Raises TransformError where they go round."""
        frames = [frame]
        while (link := self._links.get(frames[-1])) is not None:
            if link.parent in frames:
                raise TransformError(
                    f"transforms go round: {' -> '.join([*frames, link.parent])}; mend who sends them"
                )
            frames.append(link.parent)
        return frames

    def _missing(self, target: str, source: str) -> str:
        known = {*self._links, *(link.parent for link in self._links.values())}
        unknown = [repr(frame) for frame in (target, source) if frame not in known]
        why = f"nothing has told of {' and '.join(unknown)}" if unknown else "nothing joins the two"
        return (
            f"no transform from {target!r} to {source!r}: {why}; start what publishes it on /tf or /tf_static"
        )

    def _at(self, child: str, stamp_s: float) -> Transform:
        """A frame in its parent. Raises TransformError."""
        link = self._links[child]
        if link.static:
            return link.told[0]
        stamps_s = link.stamps_s
        later = bisect_right(stamps_s, stamp_s)
        name = f"the transform from {link.parent!r} to {child!r}"
        if later == 0:
            ahead_s = stamps_s[0] - stamp_s
            raise TransformError(
                f"{name} is of the future: it begins {ahead_s:.2f} s after what is asked for; "
                "its sender has another clock"
            )
        if later == len(stamps_s):
            age_s = stamp_s - stamps_s[-1]
            if age_s > self._tolerance_s + 1e-6:
                raise TransformError(
                    f"{name} is stale: it is {age_s:.2f} s old, and {self._tolerance_s:g} s are allowed "
                    f"(transform_tolerance); see what publishes it"
                )
            return link.told[-1]
        before_s, after_s = stamps_s[later - 1], stamps_s[later]
        return between(link.told[later - 1], link.told[later], (stamp_s - before_s) / (after_s - before_s))


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The rotation b, then a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _rotated(q: Quaternion, v: Vector | list[float]) -> Vector:
    """v + 2 w (u x v) + 2 u x (u x v), u the vector part."""
    x, y, z, w = q
    cx, cy, cz = y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]
    return (
        v[0] + 2.0 * (w * cx + y * cz - z * cy),
        v[1] + 2.0 * (w * cy + z * cx - x * cz),
        v[2] + 2.0 * (w * cz + x * cy - y * cx),
    )


def _unit(q: Quaternion) -> Quaternion:
    length = math.sqrt(sum(part * part for part in q))
    x, y, z, w = (part / length for part in q)
    return x, y, z, w
