"""Map files of ROS map_server, written for tests."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image


def write_map(folder: Path, pixels: Any, suffix: str = ".pgm", **header: Any) -> Path:
    """Path of the YAML file. pixels (H, W) or (H, W, C), top row first; a header entry of None is omitted."""
    Image.fromarray(np.asarray(pixels, dtype=np.uint8)).save(folder / f"image{suffix}")
    content = {
        "image": f"image{suffix}",
        "resolution": 0.05,
        "origin": [0.0, 0.0, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    path = folder / "map.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in (content | header).items() if v is not None}))
    return path
