"""What a policy sees: scan, goal, twist, last action and motion cues, in one vector. Training and robots share it."""

from adrl.observation.encoder import (
    EncoderConfig,
    Mirror,
    ObservationEncoder,
    footprint_extent,
    in_robot_frame,
    to_action,
    to_twist,
)

__all__ = [
    "EncoderConfig",
    "Mirror",
    "ObservationEncoder",
    "footprint_extent",
    "in_robot_frame",
    "to_action",
    "to_twist",
]
