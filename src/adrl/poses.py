"""The name of before for adrl.geometry, which is where this lives."""

from adrl.geometry import Pose, compose, inverse, quaternion_of, yaw_of

__all__ = ["Pose", "compose", "inverse", "quaternion_of", "yaw_of"]
