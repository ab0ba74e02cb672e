"""What solids cover between two heights, held against points drawn inside them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from adrl.types import Array
from adrl.worlds.sdf.footprint import Box, Footprint, Round, Solid, capsule, cone, cylinder, ellipsoid, sphere

BAND = (0.05, 0.5)
ANGLE = st.floats(-3.2, 3.2) | st.sampled_from([0.0, 0.5 * math.pi, math.pi, 0.004])


def inside_box(p: Array) -> NDArray[np.bool_]:
    return np.all(np.abs(p) <= (0.5, 0.3, 0.2), axis=1)


def inside_cylinder(p: Array) -> NDArray[np.bool_]:
    return (np.hypot(p[:, 0], p[:, 1]) <= 0.3) & (np.abs(p[:, 2]) <= 0.6)


def inside_capsule(p: Array) -> NDArray[np.bool_]:
    along = np.clip(p[:, 2], -0.4, 0.4)
    return np.linalg.norm(p - along[:, None] * (0.0, 0.0, 1.0), axis=1) <= 0.2


def inside_ellipsoid(p: Array) -> NDArray[np.bool_]:
    return ((p / (0.5, 0.3, 0.2)) ** 2).sum(axis=1) <= 1.0


def inside_cone(p: Array) -> NDArray[np.bool_]:
    return (np.abs(p[:, 2]) <= 0.5) & (np.hypot(p[:, 0], p[:, 1]) <= 0.4 * (0.5 - p[:, 2]))


SOLIDS = {
    "box": (lambda pose: Box(pose, np.array((0.5, 0.3, 0.2))), inside_box),
    "cylinder": (lambda pose: cylinder(pose, 0.3, 1.2), inside_cylinder),
    "capsule": (lambda pose: capsule(pose, 0.2, 0.8), inside_capsule),
    "ellipsoid": (lambda pose: ellipsoid(pose, np.array((0.5, 0.3, 0.2))), inside_ellipsoid),
    "cone": (lambda pose: cone(pose, 0.4, 1.0), inside_cone),
}


def placed(z: float, roll: float, pitch: float, yaw: float) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", (roll, pitch, yaw)).as_matrix()
    pose[:3, 3] = (1.0, -2.0, z)
    return pose


def distance(footprint: Footprint, points: Array) -> Array:
    """Of each point from the footprint, 0 inside."""
    found = np.full(len(points), np.inf)
    for x, y, radius in footprint.circles:
        found = np.minimum(found, np.maximum(0.0, np.hypot(*(points - (x, y)).T) - radius))
    for corners in footprint.polygons:
        edges = np.roll(corners, -1, axis=0) - corners
        normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.hypot(*edges.T)[:, None]
        # Of the polygon's lines, not of its corners: never more than the distance.
        out = ((points[:, None] - corners) * normals).sum(axis=2).max(axis=1)
        found = np.minimum(found, np.maximum(0.0, out))
    for a_x, a_y, b_x, b_y in footprint.segments:
        a, along = np.array((a_x, a_y)), np.array((b_x - a_x, b_y - a_y))
        share = np.clip((points - a) @ along / (along @ along), 0.0, 1.0)
        found = np.minimum(found, np.hypot(*(points - a - share[:, None] * along).T))
    return found


@pytest.mark.parametrize("kind", SOLIDS)
@given(z=st.floats(-0.9, 1.4), roll=ANGLE, pitch=ANGLE, yaw=ANGLE)
def test_a_footprint_holds_the_solid_and_little_else(
    kind: str, z: float, roll: float, pitch: float, yaw: float
) -> None:
    make, inside = SOLIDS[kind]
    pose = placed(z, roll, pitch, yaw)
    solid = make(pose)
    local = np.random.default_rng(0).uniform(-1.0, 1.0, (60_000, 3)) * (0.6, 0.6, 0.7)
    points = local[inside(local)] @ pose[:3, :3].T + pose[:3, 3]
    low, high = solid.extent
    assert (points >= low - 1e-9).all()
    assert (points <= high + 1e-9).all()
    seen = points[(points[:, 2] >= BAND[0]) & (points[:, 2] <= BAND[1])][:, :2]
    if len(seen) < 500:
        return
    footprint = solid.footprint(BAND)
    # Nearly upright is upright: what settled moves by less than a hundredth of the band.
    assert distance(footprint, seen).max() < 0.006
    for x, y, radius in footprint.circles:
        assert math.dist((x, y), seen.mean(axis=0)) < 0.3 or kind == "capsule"
        assert radius <= 0.5
    # It reaches no farther than the points do; few of them lie near the tip of a cone.
    slack = 0.25 if kind == "cone" else 0.12
    for angle in np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False):
        u = np.array((math.cos(angle), math.sin(angle)))
        reach = [(p @ u).max() for p in footprint.polygons]
        reach += [np.dot(c[:2], u) + c[2] for c in footprint.circles]
        assert max(reach) < (seen @ u).max() + slack


@pytest.mark.parametrize(
    ("solid", "circles", "corners"),
    [
        (cylinder(placed(0.3, 0, 0, 0), 0.3, 2.0), [0.3], []),
        (cylinder(placed(0.3, math.pi, 0, 0), 0.3, 2.0), [0.3], []),
        (cylinder(placed(0.3, 0.5 * math.pi, 0, 0), 0.3, 2.0), [], [(0.3, 1.0)]),
        (cylinder(placed(0.9, 0.5 * math.pi, 0, 0), 0.5, 2.0), [], [(0.3, 1.0)]),
        (capsule(placed(0.9, 0, 0, 0), 0.5, 0.4), [math.sqrt(0.25 - 0.04)], []),
        (capsule(placed(0.3, 0.5 * math.pi, 0, 0), 0.3, 2.0), [0.3, 0.3], [(0.3, 1.0)]),
        (sphere(placed(0.8, 1.0, 1.0, 0), 0.5), [0.4], []),
        (ellipsoid(placed(0.9, 0, 0, 1.0), np.array((1.0, 1.0, 0.5))), [0.6], []),
        (cone(placed(0.5, 0, 0, 0), 0.4, 1.0), [0.38], []),
        (cone(placed(0.5, math.pi, 0, 0), 0.4, 1.0), [0.2], []),
    ],
)
def test_what_stands_or_lies_is_exact(
    solid: Round, circles: list[float], corners: list[tuple[float, float]]
) -> None:
    footprint = solid.footprint(BAND)
    assert [radius for _, _, radius in footprint.circles] == pytest.approx(circles)
    assert len(footprint.polygons) == len(corners)
    for polygon, half in zip(footprint.polygons, corners, strict=True):
        np.testing.assert_allclose(np.abs(polygon - (1.0, -2.0)), np.tile(half, (4, 1)), atol=1e-9)


def test_a_tilted_board_reaches_as_far_as_the_band_sees_it() -> None:
    """A board of 2 m at 45 degrees, its middle at 0.5 m: between 0.05 and 0.5 m it covers 0.45 m of its slope."""
    board: Solid = Box(placed(0.5, 0.25 * math.pi, 0.0, 0.0), np.array((1.0, 1.0, 1e-6)))
    (corners,) = board.footprint(BAND).polygons
    assert corners.min(axis=0) - (1.0, -2.0) == pytest.approx((-1.0, -0.45), abs=1e-5)
    assert corners.max(axis=0) - (1.0, -2.0) == pytest.approx((1.0, 0.0), abs=1e-5)


def test_a_hull_of_points_on_a_line_is_a_segment() -> None:
    footprint = Footprint()
    footprint.add_hull(np.array([(0.0, 0.0), (2.0, 2.0), (1.0, 1.0)]))
    assert footprint.polygons == []
    assert sorted(np.round(footprint.segments, 9).reshape(2, 2).tolist()) == [[0.0, 0.0], [2.0, 2.0]]
