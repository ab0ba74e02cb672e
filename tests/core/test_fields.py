"""Distances on grids against brute force, SciPy and the clearance kernel."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from scipy import ndimage

from adrl import _core
from adrl.types import World
from core import twins
from core.arenas import worlds

shapes = st.tuples(st.integers(1, 24), st.integers(1, 24))
solids = hnp.arrays(np.uint8, shapes, elements=st.sampled_from([0, 0, 0, 0, 0, 0, 1]))


@given(solids)
def test_every_distance_is_the_nearest_solid_cells(solid: NDArray[np.uint8]):
    field = _core.distance_field(solid, 1.0)
    assert field.dtype == np.float32
    assert_array_equal(field, twins.distance_field(solid).astype(np.float32))


@given(solids, st.floats(0.01, 2.0))
def test_the_resolution_scales_the_field(solid: NDArray[np.uint8], resolution_m: float):
    assert_allclose(
        _core.distance_field(solid, resolution_m), twins.distance_field(solid) * resolution_m, rtol=1e-6
    )


@given(solids)
def test_a_mirrored_bitmap_has_a_mirrored_field(solid: NDArray[np.uint8]):
    field = _core.distance_field(solid, 1.0)
    for turn in (np.fliplr, np.flipud, np.transpose):
        assert_array_equal(_core.distance_field(np.ascontiguousarray(turn(solid)), 1.0), turn(field))


@pytest.mark.parametrize("density", [1e-5, 1e-3, 0.05, 0.5])
def test_large_bitmaps_against_scipy(density: float):
    rng = np.random.default_rng(3)
    solid = (rng.random((420, 610)) < density).astype(np.uint8)
    solid[200, 300] = 1
    assert_array_equal(
        _core.distance_field(solid, 1.0), np.asarray(ndimage.distance_transform_edt(solid == 0), np.float32)
    )


def test_nothing_solid_is_infinitely_far():
    assert np.all(np.isinf(_core.distance_field(np.zeros((5, 7), dtype=np.uint8), 0.05)))
    assert_array_equal(_core.distance_field(np.ones((5, 7), dtype=np.uint8), 0.05), 0.0)
    assert _core.distance_field(np.zeros((0, 7), dtype=np.uint8), 0.05).shape == (0, 7)


def test_any_number_but_zero_is_solid():
    assert_array_equal(
        _core.distance_field(np.array([[255, 0, 0, 2]], dtype=np.uint8), 1.0), [[0.0, 1.0, 1.0, 0.0]]
    )


@settings(max_examples=40)
@given(
    worlds(),
    st.floats(-3.0, 1.0),
    st.floats(-3.0, 1.0),
    st.sampled_from([0.1, 0.25, 0.4]),
    st.floats(0.05, 2.0),
)
def test_a_field_of_clearances_is_the_twins(
    world: World, x: float, y: float, resolution_m: float, limit_m: float
):
    """The clearance of a point at every cell's centre; moving discs do not count, insides are 0."""
    still = dataclasses.replace(world, discs=np.empty((0, 8)))
    field = _core.clearance_field(world.native, x, y, 7, 5, resolution_m, limit_m)
    assert field.shape == (5, 7)
    for row in range(5):
        for column in range(7):
            pose = (x + (column + 0.5) * resolution_m, y + (row + 0.5) * resolution_m, 0.0)
            expected = twins.clearance(still, pose, 0.0, np.empty((0, 2)), limit_m)
            assert_allclose(field[row, column], max(expected, 0.0), atol=1e-6)


@settings(max_examples=50)
@given(worlds(), st.floats(0.05, 2.0))
def test_a_field_agrees_with_the_clearance_kernel_all_over_the_world(world: World, limit_m: float):
    still = dataclasses.replace(world, discs=np.empty((0, 8)))
    field = _core.clearance_field(world.native, -5.0, -5.0, 40, 40, 0.25, limit_m)
    rows, columns = np.indices(field.shape)
    poses = np.stack([(columns + 0.5) * 0.25 - 5.0, (rows + 0.5) * 0.25 - 5.0, 0.0 * rows], axis=-1).reshape(
        -1, 3
    )
    exact = _core.clearance(still.native, poses, 0.0, np.empty((0, 2)), limit_m).reshape(field.shape)
    assert_allclose(field, np.maximum(exact, 0.0), atol=1e-6)


def test_arrays_of_the_wrong_kind_are_refused():
    for solid in (np.zeros((4, 4)), np.zeros((4, 4), dtype=bool), np.zeros((4, 8), dtype=np.uint8)[:, ::2]):
        with pytest.raises(TypeError):
            _core.distance_field(solid, 1.0)  # pyright: ignore[reportArgumentType]
