"""Arrays and worlds as a page holds them: short, and exact to what a screen shows."""

import base64
import io
import math
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from adrl.report.figures import draw_world
from adrl.types import World

SOLID = (128, 135, 146)
"""Grey that stands out from white and from black."""
PICTURE_PX = 1100


def numbers(array: Any, digits: int = 5) -> list[float | None]:
    """Floats rounded to significant digits; None for what JSON does not have."""
    return [
        float(f"{value:.{digits}g}") if math.isfinite(value) else None
        for value in np.asarray(array, np.float64).ravel()
    ]


def packed(array: NDArray[Any], largest: float | None = None) -> dict[str, Any]:
    """16 bits a number, or 8 where the largest value is known and none is negative; scale * integer is the value."""
    values = np.asarray(array, np.float64)
    if largest is None:
        dtype, top = np.dtype("<i2"), 32767
        largest = float(np.abs(values).max(initial=1e-30))
    else:
        dtype, top = np.dtype("u1"), 255
    scale = largest / top
    integers = np.clip(np.rint(values / scale), -top, top).astype(dtype)
    return {
        "shape": list(values.shape),
        "bits": 8 * dtype.itemsize,
        "scale": scale,
        "data": base64.b64encode(integers.tobytes()).decode(),
    }


def world_content(world: World) -> dict[str, Any]:
    """The geometry; a bitmap is a picture of a pixel a cell."""
    content: dict[str, Any] = {"bounds": numbers(world.bounds)} | obstacles(world)
    if world.grid is not None:
        solid = np.asarray(world.grid.solid) != 0
        content["grid"] = {
            "picture": _bitmap(solid),
            "size": [solid.shape[1], solid.shape[0]],
            "resolution_m": world.grid.resolution_m,
            "origin": numbers(world.grid.origin, 8),
        }
    return content


def obstacles(world: World) -> dict[str, Any]:
    """What stands and moves in a world, without its bitmap; a disc that never stops has stop_s null."""
    return {
        "circles": numbers(world.circles),
        "polygons": [numbers(corners) for corners in world.polygons],
        "segments": numbers(world.segments),
        "discs": numbers(world.discs),
    }


def world_picture(world: World) -> str:
    """The world's bounds as a transparent PNG, as a data URI."""
    x_min, y_min, x_max, y_max = world.bounds
    scale = PICTURE_PX / max(x_max - x_min, y_max - y_min) / 100.0
    # At least a pixel wide and high.
    size = (max((x_max - x_min) * scale, 0.01), max((y_max - y_min) * scale, 0.01))
    figure = Figure(figsize=size, dpi=100)
    FigureCanvasAgg(figure)
    figure.patch.set_alpha(0.0)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    draw_world(axes, world)
    axes.set_xlim(x_min, x_max)
    axes.set_ylim(y_min, y_max)
    axes.set_axis_off()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", transparent=True)
    picture = Image.open(buffer).quantize(32)
    return _data_uri(picture)


def _bitmap(solid: NDArray[np.bool_]) -> str:
    """Row 0 of a picture is at the top, row 0 of a grid at the bottom."""
    picture = Image.fromarray(solid[::-1].astype(np.uint8), mode="P")
    picture.putpalette([255, 255, 255, *SOLID])
    picture.info["transparency"] = 0
    return _data_uri(picture)


def _data_uri(picture: Image.Image) -> str:
    buffer = io.BytesIO()
    picture.save(buffer, format="png", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


OWN_MAP = ((0, 0, 0, 0), (86, 180, 233, 60), (181, 87, 154, 255))
"""Red, green, blue and opacity of what a robot has never seen, has seen free, and holds to be solid."""


def own_map(
    log_odds: NDArray[np.int8], resolution_m: float, corner: tuple[float, float, float]
) -> dict[str, Any]:
    """A robot's own map (H, W), solid above 0 and free below, as a world's grid is given; corner: its lower left."""
    levels = np.where(log_odds > 0, 2, np.where(log_odds < 0, 1, 0)).astype(np.uint8)
    picture = Image.fromarray(levels[::-1], mode="P")
    picture.putpalette([number for colour in OWN_MAP for number in colour[:3]])
    picture.info["transparency"] = bytes(colour[3] for colour in OWN_MAP)
    return {
        "picture": _data_uri(picture),
        "size": [levels.shape[1], levels.shape[0]],
        "resolution_m": resolution_m,
        "origin": numbers(corner, 8),
    }
