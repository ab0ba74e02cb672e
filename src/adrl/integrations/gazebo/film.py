"""A drive as Gazebo's camera sees it from above."""

import io
import math
from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

from PIL import Image

from adrl.errors import WorldError
from adrl.types import World
from adrl.worlds.sdf_write import add

PIXELS = 480
FOV_RAD = 0.6
"""Narrow, from high above: walls hide little behind them."""
FRAMES_HZ = 1.0
COLUMNS = 3


def camera(world: World) -> Element:
    """A camera above the middle of the world that sees all of it; where it saves frames, the server fills in."""
    x_min, y_min, x_max, y_max = world.bounds
    height = 0.55 * max(x_max - x_min, y_max - y_min) / math.tan(0.5 * FOV_RAD)
    model = Element("model", name="camera")
    add(model, "static", "true")
    # Looking down, its picture's upper edge towards +y.
    add(
        model, "pose", 0.5 * (x_min + x_max), 0.5 * (y_min + y_max), height, 0.0, 0.5 * math.pi, 0.5 * math.pi
    )
    sensor = SubElement(SubElement(model, "link", name="link"), "sensor", name="camera", type="camera")
    add(sensor, "always_on", "true")
    add(sensor, "update_rate", FRAMES_HZ)
    lens = SubElement(sensor, "camera")
    add(lens, "horizontal_fov", FOV_RAD)
    image = SubElement(lens, "image")
    for side in ("width", "height"):
        SubElement(image, side).text = str(PIXELS)
    clip = SubElement(lens, "clip")
    add(clip, "near", 0.1)
    add(clip, "far", 2.0 * height)
    SubElement(SubElement(lens, "save", enabled="true"), "path")
    return model


def contact_sheet(frames: Sequence[bytes], count: int) -> bytes:
    """A PNG of `count` frames evenly over the drive, the first and the last among them, row by row.

    Raises WorldError without frames.
    """
    if not frames:
        raise WorldError("Gazebo's camera saved no picture; it needs a display (Xvfb) and software rendering")
    last = len(frames) - 1
    chosen = [frames[round(i * last / max(count - 1, 1))] for i in range(min(count, len(frames)))]
    columns = min(COLUMNS, len(chosen))
    size = (columns * (PIXELS + 4) - 4, -(-len(chosen) // columns) * (PIXELS + 4) - 4)
    sheet = Image.new("RGB", size, "white")
    for i, frame in enumerate(chosen):
        row, column = divmod(i, columns)
        sheet.paste(Image.open(io.BytesIO(frame)), (column * (PIXELS + 4), row * (PIXELS + 4)))
    out = io.BytesIO()
    sheet.save(out, "png")
    return out.getvalue()
