"""Imitation: demonstrations, the probe and the schedule that releases the expert."""

from adrl.imitation.demonstrations import Demonstrations, NoiseConfig, collect
from adrl.imitation.minari_dataset import Source, load_minari, save_minari

__all__ = ["Demonstrations", "NoiseConfig", "Source", "collect", "load_minari", "save_minari"]
