"""A slow, plain twin of ORCA as people walk by it: one person's half-planes, and the velocity found by looking."""

import math
from collections.abc import Sequence
from itertools import combinations

HalfPlane = tuple[complex, complex]
"""A point and the direction, of length 1, on whose left velocities are allowed."""


def excess(plane: HalfPlane, velocity: complex) -> float:
    """How far outside of a half-plane a velocity is."""
    point, direction = plane
    return ((point - velocity) * direction.conjugate()).imag


def avoid_mover(
    at: complex,
    velocity: complex,
    other_at: complex,
    other_velocity: complex,
    radius: float,
    share: float,
    horizon_s: float,
    step_s: float,
) -> HalfPlane:
    """The change of the relative velocity out of the velocity obstacle that is least, found on its whole border."""
    apart, relative = other_at - at, velocity - other_velocity
    if abs(apart) <= radius:
        away = relative - apart / step_s
        outward = away / abs(away)
        change = outward * (radius / step_s) - away
        return velocity + share * change, outward * -1j
    centre, small = apart / horizon_s, radius / horizon_s
    half = math.asin(radius / abs(apart))  # of the cone
    axis = apart / abs(apart)
    length = math.sqrt(abs(centre) ** 2 - small**2)
    found = []
    for side in (1.0, -1.0):
        leg = axis * complex(math.cos(half), side * math.sin(half))
        along = max((relative * leg.conjugate()).real, length)
        found.append((leg * along, leg * (1j * side)))
    off = relative - centre
    # The arc between the two points where the legs touch the disc faces the origin.
    if abs(off) > 0.0:
        outward = off / abs(off)
        if (outward * axis.conjugate()).real <= -small / abs(centre) + 1e-12:
            found.append((centre + small * outward, outward))
    nearest, normal = min(found, key=lambda one: abs(one[0] - relative))
    return velocity + share * (nearest - relative), normal * -1j


def nearest_allowed(planes: Sequence[HalfPlane], max_speed: float, preferred: complex) -> complex | None:
    """The best of corners, feet of perpendiculars and crossings with the greatest speed; None where none will do."""
    points = [preferred] if abs(preferred) <= max_speed else [preferred / abs(preferred) * max_speed]
    for point, direction in planes:
        points.append(point + direction * ((preferred - point) * direction.conjugate()).real)
        middle = (point * direction.conjugate()).real
        under = middle**2 + max_speed**2 - abs(point) ** 2
        if under >= 0.0:
            points += [point + direction * (-middle + sign * math.sqrt(under)) for sign in (1.0, -1.0)]
    for (p, d), (q, e) in combinations(planes, 2):
        across = (d.conjugate() * e).imag
        if abs(across) > 1e-9:
            points.append(p + d * ((e.conjugate() * (p - q)).imag / across))
    allowed = [
        v for v in points if abs(v) <= max_speed + 1e-9 and all(excess(plane, v) <= 1e-9 for plane in planes)
    ]
    return min(allowed, key=lambda v: abs(v - preferred)) if allowed else None
