"""ROS maps against a pixel-by-pixel twin of map_server, and every way a file can be wrong."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from adrl import _core
from adrl.errors import ConfigError, MapError
from adrl.worlds.ros_map import load_grid, load_map, occupancy, read_header
from map_files import write_map

SHAPES = st.tuples(st.integers(1, 6), st.integers(1, 6))
TempFolders = pytest.TempPathFactory


def server_value(pixel: list[int], mode: str, negate: bool, occupied: float, free: float) -> int:
    """What map_server publishes for one pixel, its channels given; the last of 2 or 4 is alpha. 205 is unknown."""
    has_alpha = len(pixel) in (2, 4)
    colours = pixel[:-1] if has_alpha else pixel
    shade = sum(colours) / len(colours)
    if mode == "raw":
        return round(shade) if round(shade) <= 100 else -1
    p = shade / 255.0 if negate else (255.0 - shade) / 255.0
    if has_alpha and pixel[-1] < 255:
        return -1
    if p > occupied:
        return 100
    if p < free:
        return -1 if mode == "trinary" and shade == 205 else 0
    return -1 if mode == "trinary" else int(1 + 98 * (p - free) / (occupied - free))


@given(
    pixels=SHAPES.flatmap(lambda shape: arrays(np.uint8, shape)),
    mode=st.sampled_from(["trinary", "scale", "raw"]),
    negate=st.booleans(),
    suffix=st.sampled_from([".pgm", ".png"]),
    # Grey levels among the thresholds: p equal to a threshold is unknown.
    thresholds=st.tuples(
        st.one_of(st.floats(0.01, 0.5), st.integers(1, 127).map(lambda v: v / 255.0)),
        st.one_of(st.floats(0.51, 1.0), st.integers(130, 254).map(lambda v: v / 255.0)),
    ),
)
def test_a_grey_map_is_read_as_map_server_reads_it(
    tmp_path_factory: TempFolders,
    pixels: Any,
    mode: str,
    negate: bool,
    suffix: str,
    thresholds: tuple[float, float],
) -> None:
    free, occupied = thresholds
    value = [[server_value([int(v)], mode, negate, occupied, free) for v in row] for row in pixels]
    expected = np.array([[not 0 <= v < 50 for v in row] for row in value])
    assume(not expected.all())
    path = write_map(
        tmp_path_factory.mktemp("map"),
        pixels,
        suffix,
        mode=mode,
        negate=int(negate),
        free_thresh=free,
        occupied_thresh=occupied,
    )
    # The image's top row is the grid's last.
    np.testing.assert_array_equal(load_grid(path).solid[::-1], expected)


@given(
    pixels=st.tuples(st.integers(1, 4), st.integers(1, 4), st.sampled_from([2, 3, 4])).flatmap(
        lambda shape: arrays(np.uint8, shape, elements=st.sampled_from([0, 30, 128, 205, 254, 255]))
    ),
    mode=st.sampled_from(["trinary", "scale", "raw"]),
)
def test_colour_and_alpha_are_read_as_map_server_reads_them(
    tmp_path_factory: TempFolders, pixels: Any, mode: str
) -> None:
    value = [
        [server_value([int(c) for c in pixel], mode, False, 0.65, 0.196) for pixel in row] for row in pixels
    ]
    expected = np.array([[not 0 <= v < 50 for v in row] for row in value])
    assume(not expected.all())
    path = write_map(tmp_path_factory.mktemp("map"), pixels, ".png", mode=mode)
    np.testing.assert_array_equal(load_grid(path).solid[::-1], expected)


@given(
    solid=SHAPES.flatmap(lambda shape: arrays(np.bool_, shape)),
    resolution=st.floats(0.01, 1.0),
    origin=st.tuples(*[st.floats(-50.0, 50.0)] * 2, st.floats(-4.0, 4.0)),
)
def test_a_map_saved_in_black_and_white_comes_back(
    tmp_path_factory: TempFolders, solid: Any, resolution: float, origin: tuple[float, float, float]
) -> None:
    assume(not solid.all())
    pixels = np.where(solid, 0, 254)[::-1]
    grid = load_grid(
        write_map(tmp_path_factory.mktemp("map"), pixels, resolution=resolution, origin=list(origin))
    )
    np.testing.assert_array_equal(grid.solid, solid)
    np.testing.assert_array_equal(grid.observed_free, ~solid)
    assert (grid.resolution_m, grid.origin) == (resolution, origin)


def test_a_cell_exactly_at_a_threshold_is_unknown(tmp_path: Path) -> None:
    path = write_map(tmp_path, [[255]], free_thresh=51 / 255.0, occupied_thresh=153 / 255.0)
    shade = 255 - np.array([50, 51, 52, 152, 153, 154])
    assert occupancy(shade, 255, read_header(path)).tolist() == [0, -1, -1, -1, -1, 100]


def test_sixteen_bits_a_pixel_and_palettes_mean_the_same_grey(tmp_path: Path) -> None:
    from PIL import Image

    grey = np.array([[0, 120, 205, 254]], dtype=np.uint8)
    expected = load_grid(write_map(tmp_path, grey)).solid
    Image.fromarray(grey.astype(np.uint16) * 257).save(tmp_path / "image.png")
    (tmp_path / "map.yaml").write_text((tmp_path / "map.yaml").read_text().replace("image.pgm", "image.png"))
    np.testing.assert_array_equal(load_grid(tmp_path / "map.yaml").solid, expected)
    Image.fromarray(grey).convert("P").save(tmp_path / "image.png")
    np.testing.assert_array_equal(load_grid(tmp_path / "map.yaml").solid, expected)


def test_a_yawed_origin_turns_the_world_about_the_lower_left_corner(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    pixels = np.where(rng.random((40, 60)) < 0.05, 0, 254)
    yaw, x, y = 0.7, 3.0, -2.0
    plain = load_map(write_map(tmp_path, pixels, origin=[0.0, 0.0, 0.0]))
    turned = load_map(write_map(tmp_path, pixels, origin=[x, y, yaw]))
    poses = rng.uniform((0.0, 0.0, -math.pi), (3.0, 2.0, math.pi), (200, 3))
    c, s = math.cos(yaw), math.sin(yaw)
    moved = np.column_stack(
        [x + c * poses[:, 0] - s * poses[:, 1], y + s * poses[:, 0] + c * poses[:, 1], poses[:, 2] + yaw]
    )
    angles = np.linspace(-3.0, 3.0, 30)
    before = _core.raycast(plain.native, poses, angles, 5.0)
    after = _core.raycast(turned.native, moved, angles, 5.0)
    # A ray that passes a corner within rounding may hit on one side and miss on the other.
    assert (np.abs(before - after) < 1e-4).mean() > 0.999
    assert (before < 5.0).any()
    corners = np.array([(0, 0), (3.0, 0), (3.0, 2.0), (0, 2.0)]) @ np.array([(c, s), (-s, c)]) + (x, y)
    np.testing.assert_allclose(turned.bounds, [*corners.min(axis=0), *corners.max(axis=0)])


def test_cells_free_by_rounding_are_no_place_for_tasks(tmp_path: Path) -> None:
    # 206 is how the Willow Garage map writes unknown: p = 0.192 < 0.196.
    grid = load_grid(write_map(tmp_path, [[206, 254, 0]]))
    assert grid.solid.tolist() == [[0, 0, 1]]
    assert grid.observed_free is not None
    assert grid.observed_free.tolist() == [[False, True, False]]
    only_grey = load_grid(write_map(tmp_path, [[206, 206, 0]]))
    assert only_grey.observed_free is not None
    assert only_grey.observed_free.tolist() == [[True, True, False]]


def test_numbers_that_yaml_takes_for_text_are_numbers(tmp_path: Path) -> None:
    path = write_map(tmp_path, [[254]])
    path.write_text(path.read_text().replace("0.05", "5e-2").replace("negate: 0", "negate: false"))
    assert load_grid(path).resolution_m == 0.05


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ({"resolution": 0}, "resolution is '0'; give a number from 0.0001 to 100"),
        ({"resolution": 1e-9}, "resolution is '1e-09'"),
        ({"resolution": -0.05}, "resolution"),
        ({"resolution": math.nan}, "resolution"),
        ({"resolution": "fine"}, "resolution is 'fine'"),
        ({"resolution": True}, "resolution"),
        ({"resolution": None}, "lacks resolution"),
        ({"origin": None}, "lacks origin"),
        ({"image": None, "free_thresh": None}, "lacks image, free_thresh"),
        ({"origin": [0.0, 0.0]}, "three numbers"),
        ({"origin": 3}, "three numbers"),
        ({"origin": [0.0, math.inf, 0.0]}, "origin is 'inf'; give a number from -1e+07 to 1e+07"),
        ({"origin": [0.0, [1], 0.0]}, "origin is '[1]'"),
        ({"origin": [0.0, "9" * 5000, 0.0]}, "origin is '999"),
        ({"occupied_thresh": 0.1}, "0 <= free <= occupied <= 1"),
        ({"free_thresh": -0.1}, "free_thresh is '-0.1'; give a number from 0 to 1"),
        ({"occupied_thresh": 65}, "occupied_thresh is '65'; give a number from 0 to 1"),
        ({"free_thresh": math.nan}, "free_thresh"),
        ({"negate": 2}, "negate"),
        ({"mode": "gray"}, "'gray'"),
        ({"image": 7}, "image is 7"),
        ({"image": "gone.pgm"}, "gone.pgm does not exist"),
        ({"image": "map.yaml"}, "cannot be read"),
        ({"image": "."}, "no ordinary file"),
        ({"image": "/dev/zero"}, "no ordinary file"),
    ],
)
def test_a_bad_header_is_named_with_its_fault(tmp_path: Path, header: dict[str, Any], says: str) -> None:
    path = write_map(tmp_path, [[254]], **header)
    with pytest.raises(MapError) as caught:
        load_map(path)
    assert says in str(caught.value)
    assert str(tmp_path) in str(caught.value) or "/dev/zero" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["", "- 1\n- 2\n", "just text", "a: [", "a: b: c", "when: 2020-13-45", "[" * 5000]
)
def test_what_is_not_a_yaml_mapping_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "map.yaml"
    path.write_text(text)
    with pytest.raises(MapError, match=r"map\.yaml"):
        load_map(path)


def test_yaml_cannot_build_objects(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    path.write_text("!!python/object/apply:os.getcwd []")
    with pytest.raises(MapError, match="not valid YAML"):
        load_map(path)


def test_a_missing_map_a_folder_and_an_image_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="does not exist"):
        load_map(tmp_path / "none.yaml")
    with pytest.raises(MapError, match="cannot be read"):
        load_map(tmp_path)
    write_map(tmp_path, [[255, 0]], ".png")
    with pytest.raises(MapError, match="not the image"):
        load_map(tmp_path / "image.png")


@pytest.mark.parametrize("suffix", [".pgm", ".png"])
def test_a_truncated_image_is_refused(tmp_path: Path, suffix: str) -> None:
    path = write_map(tmp_path, np.arange(10_000).reshape(100, 100) % 251, suffix)
    image = tmp_path / f"image{suffix}"
    image.write_bytes(image.read_bytes()[:300])
    with pytest.raises(MapError, match="cannot be read"):
        load_map(path)


@pytest.mark.parametrize(
    ("pixels", "header", "says"),
    [
        ([[0, 205], [100, 0]], {}, "probability 0.196, and free_thresh is 0.196; raise that"),
        ([[254, 205]], {"free_thresh": 0.0}, "probability 0.004, and free_thresh is 0; raise that"),
        ([[0, 0]], {}, "is negate right, which is 0?"),
        ([[254, 254]], {"negate": 1}, "is negate right, which is 1?"),
        ([[0, 205]], {"free_thresh": 0.25}, "--unknown free"),
        ([[254, 205]], {"mode": "raw"}, "grey 0 to 49"),
        ([[[254, 0], [0, 0]]], {}, "without alpha"),
    ],
)
def test_a_map_without_a_free_cell_is_refused_and_told_why(
    tmp_path: Path, pixels: Any, header: dict[str, Any], says: str
) -> None:
    path = write_map(tmp_path, pixels, ".png", **header)
    with pytest.raises(MapError, match="no free cell") as caught:
        load_map(path)
    assert says in str(caught.value)


def solid(path: Path, unknown: Any = "solid") -> list[list[int]]:
    return load_grid(path, unknown).solid.tolist()


@pytest.mark.parametrize("suffix", [".pgm", ".png"])
@pytest.mark.parametrize("thresholds", [(0.65, 0.25), (0.65, 0.196), (0.5, 0.5), (0.9, 0.9)])
def test_unknown_is_unknown_whatever_the_thresholds(
    tmp_path: Path, suffix: str, thresholds: tuple[float, float], caplog: pytest.LogCaptureFixture
) -> None:
    occupied, free = thresholds
    path = write_map(tmp_path, [[0, 205, 254]], suffix, occupied_thresh=occupied, free_thresh=free)
    assert solid(path) == [[1, 1, 0]]
    (*said,) = caplog.messages
    if free == 0.196:  # map_server says unknown as well
        assert said == []
    else:
        (line,) = said
        assert str(path) in line
        assert "33% of its cells are grey 205" in line
        assert "--unknown free" in line
    assert solid(path, "free") == [[1, 0, 0]]
    assert len(caplog.messages) == len(said)


def test_grey_205_is_free_where_no_map_saver_wrote_it(tmp_path: Path) -> None:
    assert solid(write_map(tmp_path, [[0, 205, 254]], mode="scale", free_thresh=0.25)) == [[1, 0, 0]]
    assert solid(write_map(tmp_path, [[204, 206]], free_thresh=0.25)) == [[0, 0]]


def test_unknown_cells_that_are_free_may_have_tasks(tmp_path: Path) -> None:
    grid = load_grid(write_map(tmp_path, [[0, 205, 254]]), "free")
    assert grid.observed_free is not None
    assert grid.observed_free.tolist() == [[False, True, True]]


def test_what_unknown_cells_are_is_a_word(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="unknown is 'maybe'; give one of solid, free"):
        load_map(write_map(tmp_path, [[254]]), "maybe")  # pyright: ignore


@pytest.mark.parametrize(
    ("name", "free_m2"),
    [("willow/willow-full", 2900.0), ("depot/depot", 448.7), ("turtlebot3_world/map", 19.8)],
)
def test_the_published_maps_load(maps: Path, name: str, free_m2: float) -> None:
    grid = load_grid(maps / f"{name}.yaml")
    assert (grid.solid == 0).sum() * grid.resolution_m**2 == pytest.approx(free_m2, rel=0.05)
