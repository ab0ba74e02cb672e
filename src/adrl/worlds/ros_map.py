"""Maps of ROS map_server: a YAML file and an image (PGM, PNG, BMP, TIFF or JPEG)."""

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.errors import MapError, MissingExtra
from adrl.types import Array, OccupancyGrid, World

MODES = ("trinary", "scale", "raw")
UNKNOWN = -1


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


def load_map(path: str | os.PathLike[str]) -> World:
    """The world of a map: its solid cells and nothing else; bounds are those of the image.

    Occupied and unknown cells are solid. Raises MapError, which names the file and says what to do; MissingExtra
    without pyyaml or pillow.
    """
    grid = load_grid(path)
    height, width = grid.solid.shape
    x, y, yaw = grid.origin
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)]) * grid.resolution_m
    rotation = np.array([(math.cos(yaw), math.sin(yaw)), (-math.sin(yaw), math.cos(yaw))])
    corners = corners @ rotation + (x, y)
    (x_min, y_min), (x_max, y_max) = corners.min(axis=0), corners.max(axis=0)
    return World(bounds=(float(x_min), float(y_min), float(x_max), float(y_max)), grid=grid)


def load_grid(path: str | os.PathLike[str]) -> OccupancyGrid:
    """The occupancy grid of a map. Raises MapError.

    observed_free holds the free cells with p <= free_thresh / 2. The Willow Garage map writes unknown as grey
    206, p = 0.192, which its free_thresh of 0.196 rounds to free: without this rule tasks would start outside
    the building. A map without a cell that light takes every free cell.
    """
    header = read_header(Path(path))
    probability, opaque = _read_image(header)
    value = occupancy(probability, opaque, header)
    # Row 0 of the image is the top, row 0 of the grid the bottom.
    value, probability = np.flipud(value), np.flipud(probability)
    free = (value >= 0) & (value < 50)
    if not free.any():
        raise MapError(
            f"map {path} has no free cell: compare {header.image.name} with negate, occupied_thresh and "
            "free_thresh"
        )
    # Only cells map_server calls 0; where a scale map has none, the half that is more likely free than not.
    surely = (value == 0) & (probability <= 0.5 * header.free_thresh)
    return OccupancyGrid(
        solid=np.ascontiguousarray(~free, dtype=np.uint8),
        resolution_m=header.resolution_m,
        origin=header.origin,
        observed_free=np.ascontiguousarray(surely if surely.any() else free),
    )


def occupancy(probability: Array, opaque: NDArray[np.bool_], header: MapHeader) -> NDArray[np.int8]:
    """(H, W) probabilities that a cell is occupied -> (H, W) values as map_server publishes them.

    trinary: 100 where p > occupied_thresh, 0 where p < free_thresh, else -1 (unknown).
    scale: the same, but 1 to 99 in proportion between the thresholds; a pixel that is not opaque is unknown
    (Nav2). raw: the pixel's own value where it is at most 100, else unknown.
    """
    if header.mode == "raw":
        grey = np.rint(probability * 255.0)
        return np.where(grey <= 100, grey, UNKNOWN).astype(np.int8)
    value = np.full(probability.shape, UNKNOWN, dtype=np.int8)
    if header.mode == "scale":
        ratio = (probability - header.free_thresh) / (header.occupied_thresh - header.free_thresh)
        value[:] = np.clip(1.0 + 98.0 * ratio, 1.0, 99.0).astype(np.int8)
    value[probability > header.occupied_thresh] = 100
    value[probability < header.free_thresh] = 0
    if header.mode == "scale":
        value[~opaque] = UNKNOWN
    return value


def read_header(path: Path) -> MapHeader:
    """The checked content of a map's YAML file. Raises MapError."""
    try:
        import yaml
    except ModuleNotFoundError as error:
        raise MissingExtra.of(error) from None
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise MapError(f"map {path} does not exist; give the YAML file that map_saver writes") from None
    except (OSError, UnicodeDecodeError) as error:
        raise MapError(f"map {path} cannot be read: {error}; give the YAML file, not the image") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise MapError(f"map {path} is not valid YAML: {error}") from None
    if not isinstance(content, dict):
        raise MapError(f"map {path} is not a YAML mapping; it needs lines such as 'resolution: 0.05'")
    required = ("image", "resolution", "origin", "occupied_thresh", "free_thresh")
    missing = [key for key in required if key not in content]
    if missing:
        raise MapError(f"map {path} lacks {', '.join(missing)}; map_server needs {', '.join(required)}")
    if not isinstance(content["image"], str) or not content["image"]:
        raise MapError(f"map {path}: image is {content['image']!r}; give the image's file name")
    mode = str(content.get("mode", "trinary")).lower()
    if mode not in MODES:
        raise MapError(f"map {path}: mode is {mode!r}; give one of {', '.join(MODES)}")
    occupied = _number(path, "occupied_thresh", content["occupied_thresh"])
    free = _number(path, "free_thresh", content["free_thresh"])
    if not 0.0 <= free < occupied <= 1.0:
        raise MapError(
            f"map {path}: free_thresh is {free}, occupied_thresh {occupied}; need 0 <= free < occupied <= 1"
        )
    return MapHeader(
        image=path.parent / content["image"],
        resolution_m=_resolution(path, content["resolution"]),
        origin=_origin(path, content["origin"]),
        occupied_thresh=occupied,
        free_thresh=free,
        negate=_negate(path, content.get("negate", 0)),
        mode=mode,
    )


def _number(path: Path, key: str, value: Any) -> float:
    try:
        # Text too: YAML 1.1 reads 5e-2 as text, and map_server takes it for a number.
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise MapError(f"map {path}: {key} is {value!r}; give a finite number")
    return number


def _resolution(path: Path, value: Any) -> float:
    resolution = _number(path, "resolution", value)
    if resolution <= 0.0:
        raise MapError(f"map {path}: resolution is {resolution}; give metres a pixel, e.g. 0.05")
    return resolution


def _origin(path: Path, value: Any) -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3:
        raise MapError(f"map {path}: origin is {value!r}; give three numbers, [x, y, yaw]")
    x, y, yaw = (_number(path, "origin", number) for number in value)
    return x, y, yaw


def _negate(path: Path, value: Any) -> bool:
    if value not in (0, 1):  # True and False too
        raise MapError(f"map {path}: negate is {value!r}; give 0 or 1")
    return bool(value)


def _read_image(header: MapHeader) -> tuple[Array, NDArray[np.bool_]]:
    """(H, W) probability of being occupied, top row first, and (H, W) whether the pixel is opaque.

    p = (255 - v) / 255, or v / 255 with negate; v is the mean of the channels. As in map_server, alpha counts
    as one of them in trinary mode and in no other. raw keeps v / 255 whatever negate says (Nav2).
    """
    try:
        from PIL import Image
    except ModuleNotFoundError as error:
        raise MissingExtra.of(error) from None

    try:
        with Image.open(header.image, formats=("PPM", "PNG", "BMP", "TIFF", "JPEG")) as image:
            channels, has_alpha = _channels(image)
    except FileNotFoundError:
        raise MapError(f"map image {header.image} does not exist; correct image: in the YAML") from None
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
        raise MapError(f"map image {header.image} cannot be read: {error}; save it again as PNG") from None
    opaque = channels[..., -1] >= 255.0 if has_alpha else np.ones(channels.shape[:2], dtype=np.bool_)
    if has_alpha and header.mode != "trinary":
        channels = channels[..., :-1]
    shade = channels.mean(axis=-1)
    if header.mode == "raw" or header.negate:
        return shade / 255.0, opaque
    return (255.0 - shade) / 255.0, opaque


def _channels(image: Any) -> tuple[Array, bool]:
    """(H, W, C) values from 0 to 255 and whether the last channel is alpha."""
    if image.mode == "P":
        image = image.convert("RGBA" if "transparency" in image.info else "RGB")
    elif image.mode == "1":
        image = image.convert("L")
    elif image.mode not in ("L", "LA", "RGB", "RGBA") and not image.mode.startswith("I"):
        image = image.convert("RGB")
    values = np.asarray(image, dtype=np.float64)
    if image.mode.startswith("I"):  # 16 bits a pixel
        values = values / 257.0
    return values.reshape(*values.shape[:2], -1), image.mode in ("LA", "RGBA")
