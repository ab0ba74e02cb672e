"""Gazebo 11 in lock-step: the same tasks, observations and policies, moved and sensed by Gazebo."""

from adrl.integrations.gazebo.simulator import Gazebo

__all__ = ["Gazebo"]
