"""What a policy sees: scan, goal, twist, last action and motion cues, in one vector. Training and robots share it."""

from adrl.geometry import in_robot_frame
from adrl.observation.actions import to_action, to_twist
from adrl.observation.component import Component, Mirror, Senses
from adrl.observation.config import EncoderConfig
from adrl.observation.decoder import Decoded, ObservationDecoder
from adrl.observation.encoder import COMPONENTS, ObservationEncoder
from adrl.observation.measurements import Encoder, Measured, Measurements, needs_path
from adrl.observation.scan import footprint_extent

__all__ = [
    "COMPONENTS",
    "Component",
    "Decoded",
    "Encoder",
    "EncoderConfig",
    "Measured",
    "Measurements",
    "Mirror",
    "ObservationDecoder",
    "ObservationEncoder",
    "Senses",
    "footprint_extent",
    "in_robot_frame",
    "needs_path",
    "to_action",
    "to_twist",
]
