"""/tf and /tf_static."""

from collections.abc import Callable
from typing import Any

from adrl.deploy.frames import Frames

TF = {"/tf": False, "/tf_static": True}
"""Topic -> whether what it tells holds at all times."""


def take_transforms(frames: Frames, message: Any, seconds: Callable[[Any], float], *, static: bool) -> None:
    """Of a tf2_msgs/TFMessage. seconds: of a stamp."""
    for link in message.transforms:
        place, turn = link.transform.translation, link.transform.rotation
        frames.take(
            link.header.frame_id,
            link.child_frame_id,
            seconds(link.header.stamp),
            (place.x, place.y, place.z),
            (turn.x, turn.y, turn.z, turn.w),
            static=static,
        )
