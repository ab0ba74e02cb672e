"""Imitation: demonstrations, the probe and the schedule that releases the expert."""

from adrl.imitation.bag_demonstrations import BagSummary, read_demonstrations
from adrl.imitation.bag_recording import BagTopics
from adrl.imitation.demonstrations import Demonstrations, NoiseConfig, collect
from adrl.imitation.experts import Driver, Expert, find_expert
from adrl.imitation.minari_dataset import Source, load_minari, recorded_worlds, require_minari, save_minari

__all__ = [
    "BagSummary",
    "BagTopics",
    "Demonstrations",
    "Driver",
    "Expert",
    "NoiseConfig",
    "Source",
    "collect",
    "find_expert",
    "load_minari",
    "read_demonstrations",
    "recorded_worlds",
    "require_minari",
    "save_minari",
]
