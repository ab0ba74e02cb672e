"""Maps of ROS map_server: a YAML file and an image (PGM, PNG, BMP, TIFF or JPEG)."""

import io
import logging
import math
import os
import struct
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError, FileError, MapError, MissingExtra, brief
from adrl.files import read_bytes
from adrl.types import Array, OccupancyGrid, World
from adrl.worlds.shapes import place

LOG = logging.getLogger("adrl.worlds")
Unknown = Literal["solid", "free"]
"""What a cell is that nothing has looked at."""
MODES = ("trinary", "scale", "raw")
RESOLUTION_M = (1e-4, 100.0)
MOST_M = 1e7
"""The greatest northing of a UTM zone: coordinates of maps go no further."""
NO, YES = ("0", "false", "no", "off", "n"), ("1", "true", "yes", "on", "y")
UNKNOWN = -1
UNKNOWN_GREY = 205
"""What map_saver writes for unknown in mode trinary, of 255."""
IMAGE_FORMATS = ("PPM", "PNG", "BMP", "TIFF", "JPEG")
"""PGM is one of PPM's."""
MAX_IMAGE_BYTES = 2**28


@dataclass(frozen=True, kw_only=True)
class MapHeader:
    """What the YAML file says."""

    image: Path
    resolution_m: float
    """Side of a pixel."""
    origin: tuple[float, float, float]
    """(x, y, yaw) of the lower left corner of the lower left pixel."""
    occupied_thresh: float
    free_thresh: float
    negate: bool = False
    mode: str = "trinary"


@dataclass(frozen=True, eq=False, kw_only=True)
class MapImage:
    """What the image file holds."""

    shade: NDArray[np.unsignedinteger]
    """(H, W) brightness of the pixels from 0 to white, top row first."""
    white: int
    opaque: NDArray[np.bool_]
    """(H, W) whether nothing shines through the pixel."""


def load_map(path: str | os.PathLike[str], unknown: Unknown = "solid") -> World:
    """The world of a map: its solid cells and nothing else; bounds are those of the image.

    Occupied cells are solid, and unknown ones unless they are to be free. Raises MapError, which names the file and
    says what to do; ConfigError for another `unknown`; MissingExtra without pyyaml or pillow.
    """
    grid = load_grid(path, unknown)
    height, width = grid.solid.shape
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)]) * grid.resolution_m
    corners = place(corners, *grid.origin)
    (x_min, y_min), (x_max, y_max) = corners.min(axis=0), corners.max(axis=0)
    return World(bounds=(float(x_min), float(y_min), float(x_max), float(y_max)), grid=grid)


def load_grid(path: str | os.PathLike[str], unknown: Unknown = "solid") -> OccupancyGrid:
    """The occupancy grid of a map. Raises as load_map does.

    A trinary map may have the grey that map_saver writes for unknown, 205, with a free_thresh that reads it as free:
    Nav2 saves 0.25. Such cells are unknown here, and one line of the log says so.
    observed_free holds the free cells with p <= free_thresh / 2. The Willow Garage map writes unknown as grey
    206, p = 0.192, which its free_thresh of 0.196 rounds to free: without this rule tasks would start outside
    the building. A map without a cell that light, or with free unknown cells, takes every free cell.
    """
    if unknown not in get_args(Unknown):
        raise ConfigError(f"unknown is {unknown!r}; give one of {', '.join(get_args(Unknown))}")
    header = read_header(Path(path).expanduser())
    image = read_image(header.image)
    levels = np.arange(image.white + 1)
    value = occupancy(levels, image.white, header)
    surely = (value == 0) & (2.0 * probability(levels, image.white, header) <= header.free_thresh)
    is_unknown_grey = levels * 255 == UNKNOWN_GREY * image.white
    taken = int(np.count_nonzero(is_unknown_grey[image.shade])) if header.mode == "trinary" else 0
    if unknown == "solid" and taken and (value[is_unknown_grey] == 0).any():
        value[is_unknown_grey] = UNKNOWN
        LOG.warning(
            f"map {path}: {taken / image.shade.size:.0%} of its cells are grey {UNKNOWN_GREY}, which map_saver writes "
            f"for unknown and free_thresh {header.free_thresh:g} would read as free; they are taken as unknown "
            "(--unknown free takes all unknown cells as free)"
        )
    free = (value >= 0) & (value < 50)
    if unknown == "free":
        free |= value == UNKNOWN
    clear = image.opaque | (header.mode == "raw") | (unknown == "free")
    solid = ~(free[image.shade] & clear)
    if solid.all():
        raise MapError(f"map {path} has no free cell: {_why_nothing_is_free(header, image)}")
    # Where a scale map has no cell that map_server calls 0: the half that is more likely free than not.
    seen = surely[image.shade] & ~solid if unknown == "solid" else ~solid
    # Row 0 of the image is the top, row 0 of the grid the bottom.
    return OccupancyGrid(
        solid=np.ascontiguousarray(np.flipud(solid), dtype=np.uint8),
        resolution_m=header.resolution_m,
        origin=header.origin,
        observed_free=np.ascontiguousarray(np.flipud(seen if seen.any() else ~solid)),
    )


def probability(shade: NDArray[np.integer], white: int, header: MapHeader) -> Array:
    """Brightness from 0 to white -> probability that the cell is occupied: darkness; brightness with negate or raw."""
    bright = shade if header.negate or header.mode == "raw" else white - shade
    return bright / white


def occupancy(shade: NDArray[np.integer], white: int, header: MapHeader) -> NDArray[np.int8]:
    """Brightness of opaque pixels, from 0 to white -> values as map_server publishes them.

    trinary: 100 where p > occupied_thresh, 0 where p < free_thresh, else -1 (unknown); Nav2 since 2025 counts a p at
    a threshold, too. scale: the same, but 1 to 99 in proportion between the thresholds. raw: the pixel's own value
    where it is at most 100, else unknown, whatever negate says (Nav2).
    """
    if header.mode == "raw":
        grey = np.rint(shade * (255.0 / white))
        return np.where(grey <= 100, grey, UNKNOWN).astype(np.int8)
    p = probability(shade, white, header)
    value = np.full(p.shape, UNKNOWN, dtype=np.int8)
    if header.mode == "scale" and header.occupied_thresh > header.free_thresh:
        ratio = (p - header.free_thresh) / (header.occupied_thresh - header.free_thresh)
        value[:] = np.clip(1.0 + 98.0 * ratio, 1.0, 99.0).astype(np.int8)
    value[p > header.occupied_thresh] = 100
    value[p < header.free_thresh] = 0
    return value


def _why_nothing_is_free(header: MapHeader, image: MapImage) -> str:
    """What to do about it."""
    if not image.opaque.any() and header.mode != "raw":
        return (
            f"all pixels of {header.image.name} are transparent, which means unknown; save it without alpha"
        )
    if header.mode == "raw":
        return f"mode raw takes grey 0 to 49 for free and {header.image.name} has none; give mode: trinary"
    p = float(probability(image.shade[image.opaque], image.white, header).min())
    if p < header.free_thresh:
        return f"all that could be free is grey {UNKNOWN_GREY}, which means unknown; --unknown free takes that as free"
    if p > header.occupied_thresh:
        return (
            f"all of {header.image.name} reads as occupied; is negate right, which is {int(header.negate)}?"
        )
    return (
        f"the most free pixel of {header.image.name} is occupied with probability {p:.3f}, and free_thresh is "
        f"{header.free_thresh:g}; raise that if this pixel is free"
    )


def read_header(path: Path) -> MapHeader:
    """The checked content of a map's YAML file. Raises MapError."""
    try:
        from adrl.yaml_files import read_yaml
    except ModuleNotFoundError as error:
        raise MissingExtra.of(error) from None
    try:
        content = read_yaml(path)
    except FileError as error:
        raise MapError(
            f"map {path} {error}; give the YAML file that map_saver writes, not the image"
        ) from None
    if not isinstance(content, dict):
        raise MapError(f"map {path} is not a YAML mapping; it needs lines such as 'resolution: 0.05'")
    required = ("image", "resolution", "origin", "occupied_thresh", "free_thresh")
    missing = [key for key in required if key not in content]
    if missing:
        raise MapError(f"map {path} lacks {', '.join(missing)}; map_server needs {', '.join(required)}")
    if not isinstance(content["image"], str) or not content["image"]:
        raise MapError(
            f"map {path}: image is {brief(repr(content['image']))}; give the image's file name, in quotes"
        )
    mode = str(content.get("mode") or "trinary").lower()
    if mode not in MODES:
        raise MapError(f"map {path}: mode is {brief(repr(mode))}; give one of {', '.join(MODES)}")
    free, occupied = (
        _number(path, key, content[key], 0.0, 1.0) for key in ("free_thresh", "occupied_thresh")
    )
    if free > occupied:
        raise MapError(
            f"map {path}: free_thresh is {free:g}, beyond occupied_thresh {occupied:g}; need 0 <= free <= occupied <= 1"
        )
    return MapHeader(
        image=path.parent / content["image"],
        resolution_m=_number(path, "resolution", content["resolution"], *RESOLUTION_M),
        origin=_origin(path, content["origin"]),
        occupied_thresh=occupied,
        free_thresh=free,
        negate=_negate(path, content.get("negate", 0)),
        mode=mode,
    )


def _number(path: Path, key: str, value: Any, low: float = -MOST_M, high: float = MOST_M) -> float:
    try:
        # Text too: YAML 1.1 reads 5e-2 as text, and map_server takes it for a number.
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not low <= number <= high:
        raise MapError(f"map {path}: {key} is {str(value)[:40]!r}; give a number from {low:g} to {high:g}")
    return number


def _origin(path: Path, value: Any) -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3:
        raise MapError(f"map {path}: origin is {brief(repr(value))}; give three numbers, [x, y, yaw]")
    x, y, yaw = (_number(path, "origin", number) for number in value)
    return x, y, yaw


def _negate(path: Path, value: Any) -> bool:
    # yaml-cpp, which map_server uses, sees no difference between 0 and "0", and knows these words.
    word = str(value).lower()
    if word not in NO + YES:
        raise MapError(f"map {path}: negate is {brief(repr(value))}; give 0 or 1")
    return word in YES


def read_image(path: Path) -> MapImage:
    """The pixels of a map's image; the brightness of a coloured one is the mean of its channels. Raises MapError.

    Alpha is no colour: what is not opaque is unknown, as in Nav2 since 2025.
    """
    try:
        from PIL import Image
    except ModuleNotFoundError as error:
        raise MissingExtra.of(error) from None

    try:
        content = read_bytes(path, MAX_IMAGE_BYTES)
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(content), formats=IMAGE_FORMATS) as image:
                return _pixels(image)
    except FileError as error:
        raise MapError(f"map image {path} {error}; correct image: in the YAML file") from None
    except (Image.DecompressionBombWarning, Image.DecompressionBombError):
        raise MapError(f"map image {path} has more than {Image.MAX_IMAGE_PIXELS:,} pixels; cut it") from None
    except Image.UnidentifiedImageError:
        raise MapError(
            f"map image {path} cannot be read: it is none of {', '.join(IMAGE_FORMATS)}; save it as PNG"
        ) from None
    except (OSError, ValueError, SyntaxError, EOFError, OverflowError, struct.error, zlib.error) as error:
        reason = " ".join(str(error).split())
        raise MapError(f"map image {path} cannot be read: {reason}; save it again as PNG") from None


def _pixels(image: Any) -> MapImage:
    if "transparency" in image.info or image.mode == "PA":
        image = image.convert("RGBA")
    elif image.mode == "1":
        image = image.convert("L")
    elif not image.mode.startswith(("L", "RGB", "I")):
        image = image.convert("RGB")
    values = np.asarray(image)
    white = 65535 if image.mode.startswith("I") else 255
    if values.size and not 0 <= values.min() <= values.max() <= white:
        raise FileError(f"has values up to {values.max()}, and an image has 8 or 16 bits a pixel")
    values = values.reshape(*values.shape[:2], -1)
    opaque = np.broadcast_to(np.True_, values.shape[:2])
    if image.mode in ("LA", "RGBA"):
        values, opaque = values[..., :-1], values[..., -1] == white
    return MapImage(shade=values.sum(axis=-1, dtype=np.uint16), white=white * values.shape[-1], opaque=opaque)
