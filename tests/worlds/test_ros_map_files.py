"""Files of maps as people have them: spellings, image formats, damage."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from adrl.errors import MapError
from adrl.worlds.ros_map import load_grid, load_map
from map_files import write_map

TempFolders = pytest.TempPathFactory


def solid(path: Path) -> list[list[int]]:
    return load_grid(path).solid.tolist()


def test_a_map_of_two_values_is_read(tmp_path: Path) -> None:
    path = write_map(tmp_path, [[0, 127, 128, 254]], occupied_thresh=0.5, free_thresh=0.5)
    assert solid(path) == [[1, 1, 0, 0]]
    path.write_text(path.read_text() + "mode: scale\n")
    assert solid(path) == [[1, 1, 0, 0]]


@pytest.mark.parametrize(
    ("line", "instead"),
    [
        ("negate: 0", 'negate: "0"'),
        ("negate: 0", "negate: false"),
        ("negate: 0", "negate: 'no'"),
        ("negate: 0", "mode: Trinary"),
        ("negate: 0", "mode:"),
        ("resolution: 0.05", 'resolution:\t"0.05"\t# metres'),
        ("resolution: 0.05", "resolution: 5.0e-2"),
        ("resolution: 0.05", "resolution: 5e-2"),
        ("resolution: 0.05", "\ufeffresolution: 0.05"),
        ("image: image.pgm", "image: ./image.pgm"),
        ("image: image.pgm", "image: 'image.pgm'"),
        ("image: image.pgm", "image: {folder}/image.pgm"),
        ("\n", "\r\n"),
    ],
)
def test_spellings_that_map_server_takes_change_nothing(tmp_path: Path, line: str, instead: str) -> None:
    path = write_map(tmp_path, [[0, 254]])
    expected = load_grid(path)
    text = path.read_text()
    assert line in text
    rest, instead = text.replace(line, "", 1), instead.replace("{folder}", str(tmp_path))
    path.write_bytes((text.replace(line, instead) if line == "\n" else f"{instead}\n{rest}").encode())
    grid = load_grid(path)
    np.testing.assert_array_equal(grid.solid, expected.solid)
    assert (grid.resolution_m, grid.origin) == (expected.resolution_m, expected.origin)


@pytest.mark.parametrize(
    "image",
    [
        b"P2\n# by hand\n3 1\n255\n0 205 254\n",
        b"P5 3 1 255\n" + bytes([0, 205, 254]),
        b"P5\r\n3 1\r\n255\n" + bytes([0, 205, 254]),
        b"P5\n3 1\n65535\n" + np.array([0, 205 * 257, 254 * 257], dtype=">u2").tobytes(),
        b"P6\n3 1\n255\n" + bytes([0, 0, 0, 205, 205, 205, 254, 254, 254]),
    ],
)
def test_every_portable_map_reads_alike(tmp_path: Path, image: bytes) -> None:
    path = write_map(tmp_path, [[0]], free_thresh=0.25)
    (tmp_path / "image.pgm").write_bytes(image)
    assert solid(path) == [[1, 1, 0]]


def test_what_is_transparent_is_unknown_and_alpha_is_no_colour(tmp_path: Path) -> None:
    path = write_map(tmp_path, [[[0, 255], [205, 255], [254, 255], [254, 254], [254, 0]]], ".png")
    assert solid(path) == [[1, 1, 0, 1, 1]]
    palette = Image.fromarray(np.array([[0, 1, 2]], dtype=np.uint8), mode="P")
    palette.putpalette([0, 0, 0, 254, 254, 254, 254, 254, 254])
    palette.save(tmp_path / "image.png", transparency=2)
    assert solid(path) == [[1, 0, 1]]


def test_an_image_of_too_many_pixels_is_refused(tmp_path: Path) -> None:
    path = write_map(tmp_path, [[254]])
    for side in (10_000, 60_000):
        (tmp_path / "image.pgm").write_bytes(f"P5\n{side} {side}\n255\n".encode())
        with pytest.raises(MapError, match="pixels; cut it"):
            load_map(path)


@given(data=st.binary(max_size=200), suffix=st.sampled_from([".pgm", ".png"]), at=st.integers(0, 60))
def test_a_damaged_image_is_refused_or_read(
    tmp_path_factory: TempFolders, data: bytes, suffix: str, at: int
) -> None:
    path = write_map(tmp_path_factory.mktemp("map"), np.arange(100).reshape(10, 10) * 2, suffix)
    image = path.with_name(f"image{suffix}")
    whole = image.read_bytes()
    image.write_bytes(whole[:at] + data + whole[at + len(data) :])
    with contextlib.suppress(MapError):
        load_map(path)
