"""What a solid covers of the plane between two heights: circles, convex polygons and segments.

Exact for what stands upright or lies on a side; else a polygon around the exact shape, by at most 0.5 % of its
radius where it is round. Poses are (4, 4), points (..., 3), metres.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from adrl.geometry import lies_within
from adrl.types import Array
from adrl.types.polygons import turns

Band = tuple[float, float]
"""Least and greatest height."""
LEVEL_RAD = 0.01
"""Nearer to upright than this, 0.6 degrees, is upright: physics settles a model so."""
TOUCH_M = 1e-6
"""What reaches into the band by less only touches it, and is not in the way."""
SIDES = 32
"""Of the polygon around a round solid that is tilted."""


@dataclass
class Footprint:
    """What stands in the way."""

    circles: list[tuple[float, float, float]] = field(default_factory=list)
    polygons: list[Array] = field(default_factory=list)
    segments: list[tuple[float, float, float, float]] = field(default_factory=list)
    is_rough: bool = False
    """The outline of a part is rounded by more than centimetres, or but a hull."""

    def __bool__(self) -> bool:
        return bool(self.circles or self.polygons or self.segments)

    def add(self, other: "Footprint") -> None:
        """All of the other as well."""
        self.circles += other.circles
        self.polygons += other.polygons
        self.segments += other.segments
        self.is_rough |= other.is_rough

    @property
    def extent(self) -> Array:
        """(2, 2) least and greatest x, y."""
        parts = [np.empty((0, 2)), *self.polygons, np.array(self.segments).reshape(-1, 2)]
        parts += [np.array([(x - r, y - r), (x + r, y + r)]) for x, y, r in self.circles]
        points = np.concatenate(parts)
        return np.stack([points.min(axis=0), points.max(axis=0)])

    @property
    def area(self) -> float:
        """Square metres; what lies upon another counts twice."""
        rings = [float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) for x, y in (p.T for p in self.polygons)]
        return 0.5 * sum(rings) + math.pi * sum(r * r for _, _, r in self.circles)

    @property
    def middles(self) -> Array:
        """(P, 2) one point in each part."""
        parts = [np.array(self.circles).reshape(-1, 3)[:, :2]]
        parts += [polygon.mean(axis=0, keepdims=True) for polygon in self.polygons]
        parts.append(np.array(self.segments).reshape(-1, 2, 2).mean(axis=1))
        return np.concatenate(parts)

    def covers(self, points: Array) -> NDArray[np.bool_]:
        """(P, 2) points -> (P,) which lie in one of its parts."""
        within = [lies_within(polygon, points) for polygon in self.polygons]
        within += [np.hypot(*(points - (x, y)).T) < r for x, y, r in self.circles]
        return np.any(within, axis=0) if within else np.zeros(len(points), dtype=np.bool_)

    def add_hull(self, points: Array) -> None:
        """The convex hull of (N, 2) points: a polygon, or a segment where they are on a line."""
        from scipy.spatial import ConvexHull, QhullError  # not at the top: a robot has no SciPy

        points = np.unique(points.round(9), axis=0)
        try:
            corners = points[ConvexHull(points).vertices]
        except (QhullError, ValueError):
            corners = points[:0]
        # Rounding may leave corners on, or just inside, the line of their neighbours: no corners then.
        while len(corners) >= 3 and (turn := np.roll(turns(corners), 1)).min() <= 0.0:
            corners = np.delete(corners, turn.argmin(), axis=0)
        if len(corners) >= 3:
            self.polygons.append(np.ascontiguousarray(corners))
        else:
            along = points - points.mean(axis=0)
            order = along @ np.linalg.svd(along, full_matrices=False)[2][0]
            a, b = points[order.argmin()], points[order.argmax()]
            if np.hypot(*(b - a)) > 0.0:
                self.segments.append((*a, *b))


class Solid(Protocol):
    """A body at its place in the world."""

    @property
    def extent(self) -> Array:
        """(2, 3) least and greatest x, y, z."""
        ...

    def footprint(self, band: Band) -> Footprint:
        """What it covers between two heights, which its extent reaches."""
        ...


def upright(pose: Array, band: Band, reach: Array) -> tuple[Array, int | None]:
    """The pose, and which of the body's axes stands upright in it, up or down; None for none.

    A pose that is all but upright is turned upright about the point of that axis that is in the middle of what
    the band sees of it, so that the footprint moves by less than 0.01 of the band. reach: (3,) half the body along
    each axis.
    """
    axis = int(np.abs(pose[2, :3]).argmax())
    horizontal = math.hypot(pose[0, axis], pose[1, axis])
    if horizontal > math.sin(LEVEL_RAD):
        return pose, None
    if horizontal == 0.0:
        return pose, axis
    sign = math.copysign(1.0, pose[2, axis])
    first, second = [(1, 2), (2, 0), (0, 1)][axis]
    level = np.eye(4)
    along = pose[:2, first] / np.hypot(*pose[:2, first])
    level[:3, first] = (*along, 0.0)
    level[:3, axis] = (0.0, 0.0, sign)
    level[:3, second] = np.cross(level[:3, axis], level[:3, first])
    seen = np.clip(band, pose[2, 3] - reach[axis], pose[2, 3] + reach[axis]).mean() - pose[2, 3]
    level[:3, 3] = pose[:3, 3] + pose[:3, axis] * (seen * sign) - (0.0, 0.0, seen * abs(pose[2, axis]))
    return level, axis


@dataclass(frozen=True, eq=False)
class Polytope:
    """The convex hull of points."""

    points: Array
    """(N, 3) in the world."""

    @property
    def extent(self) -> Array:
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    def footprint(self, band: Band) -> Footprint:
        found = Footprint()
        found.add_hull(slab(self.points, band))
        return found


def slab(points: Array, band: Band) -> Array:
    """(M, 2) points of the plane whose hull is that of the part, between two heights, of the hull of (N, 3) points."""
    z = points[:, 2]
    parts = [points[(z >= band[0]) & (z <= band[1]), :2]]
    for height in band:
        below, above = points[z < height], points[z > height]
        share = (height - below[:, None, 2]) / (above[None, :, 2] - below[:, None, 2])
        crossing = below[:, None, :2] + share[..., None] * (above[None, :, :2] - below[:, None, :2])
        parts.append(crossing.reshape(-1, 2))
    return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class Box:
    """A cuboid about its pose."""

    pose: Array
    half: Array
    """(3,) half its size."""

    @property
    def extent(self) -> Array:
        reach = np.abs(self.pose[:3, :3]) @ self.half
        return np.stack([self.pose[:3, 3] - reach, self.pose[:3, 3] + reach])

    def footprint(self, band: Band) -> Footprint:
        pose, axis = upright(self.pose, band, self.half)
        signs = np.array([(x, y, z) for x in (1.0, -1.0) for y in (1.0, -1.0) for z in (1.0, -1.0)])
        if axis is None:
            return Polytope((signs * self.half) @ pose[:3, :3].T + pose[:3, 3]).footprint(band)
        first, second = [(1, 2), (2, 0), (0, 1)][axis]
        if pose[2, axis] < 0.0:
            first, second = second, first
        a, b = pose[:2, first] * self.half[first], pose[:2, second] * self.half[second]
        return Footprint(polygons=[np.array([a + b, b - a, -a - b, a - b]) + pose[:2, 3]])


@dataclass(frozen=True, eq=False)
class Round:
    """A convex solid that is round about its z axis, or an ellipsoid."""

    pose: Array
    reach: Array
    """(3,) half its size along each axis; the axes are in its middle."""
    support: Callable[[Array], Array]
    """(..., 3) directions in the body's frame, of any length -> (...) the greatest product with a point of it."""
    radius: Callable[[float, float], float] | None = None
    """The widest cut between two heights along its z axis, measured from its middle; None where it is not round."""
    lying: Callable[[float], tuple[float, bool]] | None = None
    """Distance of the cut from the axis -> half the cut's width beside the axis, and whether its ends are round."""

    @property
    def extent(self) -> Array:
        axes = self.pose[:3, :3]  # the rows: the world's axes in the body's frame
        return np.stack([self.pose[:3, 3] - self.support(-axes), self.pose[:3, 3] + self.support(axes)])

    def footprint(self, band: Band) -> Footprint:
        pose, axis = upright(self.pose, band, self.reach)
        x, y, z = pose[:3, 3]
        if axis == 2 and self.radius is not None:
            ends = sorted((height - z) * pose[2, 2] for height in band)
            radius = self.radius(max(ends[0], -self.reach[2]), min(ends[1], self.reach[2]))
            return Footprint(circles=[(x, y, radius)] if radius > 0.0 else [])
        if self.lying is not None and abs(self.pose[2, 2]) < math.sin(LEVEL_RAD):
            return self._lying(band)
        return self._around(band)

    def _lying(self, band: Band) -> Footprint:
        """A rectangle, with round ends or without."""
        assert self.lying is not None
        x, y, z = self.pose[:3, 3]
        width, round_ends = self.lying(abs(min(max(z, band[0]), band[1]) - z))
        along = self.pose[:2, 2] / np.hypot(*self.pose[:2, 2])
        across = np.array((-along[1], along[0])) * width
        end = along * (self.reach[2] - (self.reach[0] if round_ends else 0.0))
        found = Footprint()
        if width <= 0.0:
            return found
        corners = np.array([end + across, across - end, -end - across, end - across])
        found.add_hull(corners + self.pose[:2, 3])
        if round_ends:
            found.circles += [(x + s * end[0], y + s * end[1], width) for s in (1.0, -1.0)]
        return found

    def _around(self, band: Band) -> Footprint:
        """The polygon of SIDES tangents.

        How far the part in the band reaches along u is the least, over t, of support(u - t z) + max(t low, t high):
        every t gives a bound from above, so the polygon never cuts a piece off.
        """
        x, y, z = self.pose[:3, 3]
        low, high = band[0] - z, band[1] - z
        towards = math.atan2(self.pose[1, 2], self.pose[0, 2])
        angles = towards + 2.0 * math.pi * np.arange(SIDES) / SIDES
        u = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(SIDES)])

        def bound(turn: Array) -> Array:
            t = np.tan(turn)
            direction = u - t[:, None] * (0.0, 0.0, 1.0)
            return self.support(direction @ self.pose[:3, :3]) + np.maximum(t * low, t * high)

        left, right = np.full(SIDES, -0.4999 * math.pi), np.full(SIDES, 0.4999 * math.pi)
        for _ in range(60):  # thirds: it falls, then rises
            a, b = left + (right - left) / 3.0, right - (right - left) / 3.0
            lower = bound(a) < bound(b)
            left, right = np.where(lower, left, a), np.where(lower, b, right)
        reach = np.minimum(bound(0.5 * (left + right)), bound(np.zeros(SIDES)))
        following, next_u = np.roll(reach, -1), np.roll(u, -1, axis=0)
        sine = math.sin(2.0 * math.pi / SIDES)
        corners = np.column_stack(
            [reach * next_u[:, 1] - following * u[:, 1], following * u[:, 0] - reach * next_u[:, 0]]
        )
        found = Footprint()
        found.add_hull(corners / sine + (x, y))
        return found


def sphere(pose: Array, radius: float) -> Round:
    """A ball."""
    ball = np.eye(4)
    ball[:3, 3] = pose[:3, 3]
    return ellipsoid(ball, np.full(3, radius))


def ellipsoid(pose: Array, radii: Array) -> Round:
    """radii: (3,) along its axes."""
    a, b, c = radii

    def widest(low: float, high: float) -> float:
        return a * math.sqrt(max(0.0, 1.0 - (min(max(0.0, low), high) / c) ** 2))

    return Round(pose, radii, lambda v: np.linalg.norm(v * radii, axis=-1), widest if a == b else None)


def cylinder(pose: Array, radius: float, length: float) -> Round:
    """About its z axis."""

    def support(v: Array) -> Array:
        return radius * np.hypot(v[..., 0], v[..., 1]) + 0.5 * length * np.abs(v[..., 2])

    return Round(
        pose,
        np.array((radius, radius, 0.5 * length)),
        support,
        lambda low, high: radius if low < high else 0.0,
        lambda distance: (math.sqrt(max(0.0, radius**2 - distance**2)), False),
    )


def capsule(pose: Array, radius: float, length: float) -> Round:
    """A cylinder of this length with half a ball on either end."""

    def support(v: Array) -> Array:
        return radius * np.linalg.norm(v, axis=-1) + 0.5 * length * np.abs(v[..., 2])

    def widest(low: float, high: float) -> float:
        beyond = max(0.0, low - 0.5 * length, -0.5 * length - high)
        return math.sqrt(max(0.0, radius**2 - beyond**2))

    return Round(
        pose,
        np.array((radius, radius, 0.5 * length + radius)),
        support,
        widest,
        lambda distance: (math.sqrt(max(0.0, radius**2 - distance**2)), True),
    )


def cone(pose: Array, radius: float, length: float) -> Round:
    """Its point up, its middle half way up."""

    def support(v: Array) -> Array:
        base = radius * np.hypot(v[..., 0], v[..., 1]) - 0.5 * length * v[..., 2]
        return np.maximum(base, 0.5 * length * v[..., 2])

    reach = np.array((radius, radius, 0.5 * length))
    return Round(pose, reach, support, lambda low, _high: radius * (0.5 - low / length))
