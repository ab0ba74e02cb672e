"""The name of before for adrl.observation.motion, which is where this lives."""

from adrl.observation.motion import ScanHistory, motion_cue

__all__ = ["ScanHistory", "motion_cue"]
