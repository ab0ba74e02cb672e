"""A policy and its encoder's tables in one safetensors file, for programs with neither Python nor ONNX."""

import math

import numpy as np
from safetensors.numpy import save

from adrl.deploy.policy import MlpPolicy
from adrl.deploy.setup import setup_of
from adrl.export.onnx_graph import metadata
from adrl.observation import ObservationEncoder
from adrl.observation.body import Body
from adrl.observation.config import FOLLOWED_STEPS
from adrl.observation.motion import cue_settings
from adrl.observation.path_ahead import PATH_POINTS_M
from adrl.types import RobotConfig


def to_safetensors(policy: MlpPolicy, robot: RobotConfig | None = None) -> bytes:
    """All that examples/cpp/policy.hpp reads, of a policy on its own robot, or, for one of a family, on the one given.

    The metadata is that of the ONNX model.

    layers.I.weight (in, out), layers.I.bias (out,); encoder.beams (S, L) int32 numbers of each sector's beams,
    num_beams for none; encoder.extent (S,) metres; encoder.scales: greatest range, near_m, 1 / log1p(greatest range /
    near_m), goal_scale_m; limits: greatest speed, least speed, greatest yaw rate; lidar, float64: beams, angle_min,
    angle_increment, mount x, y, yaw, greatest range; base, float64: control period, greatest acceleration and yaw
    acceleration, lag, latency; footprint, float64: radius (1,), or corners (C, 2); with motion cues motion, float64:
    steps, margin, scale; with tracks tracks, float64: how many, and the steps between the first and the last of the
    scans that they are found in. Where the scan's scale is the same for all robots, encoder.scales has that greatest
    range for its third number, and encoder.reach is it; where the policy is told of the body, encoder.body is that.
    Where it is told the path, encoder.path, float64, is how far ahead its points lie.
    """
    setup = setup_of(policy)
    robot, config = setup.exported_for(robot), setup.encoder
    encoder, lidar = ObservationEncoder(robot, config), robot.lidar
    greatest = lidar.max_range_m
    cue = cue_settings(robot, config.num_sectors, config.history_steps)
    scales = [
        greatest,
        config.near_m,
        1.0 / math.log1p(config.reach_of(robot) / config.near_m),
        config.goal_scale_m,
    ]
    tensors = {
        "encoder.beams": encoder.beams_of_sectors,
        "encoder.extent": encoder.extent_m,
        "encoder.scales": np.array(scales, np.float32),
        "limits": np.array([robot.max_speed_mps, robot.min_speed_mps, robot.max_yaw_rate_radps], np.float64),
        "lidar": np.array([*cue[:3], *cue.mount, greatest], np.float64),
    }
    accelerations = [robot.max_acceleration_mps2, robot.max_yaw_acceleration_radps2]
    tensors["base"] = np.array(
        [robot.control_period_s, *accelerations, robot.lag_s, robot.latency_s], np.float64
    )
    tensors["footprint"] = np.array([robot.radius_m]) if robot.radius_m is not None else robot.polygon
    if config.history_steps > 0:
        tensors["motion"] = np.array([config.history_steps, cue.margin_m, cue.scale_m], np.float64)
    if config.reach_m is not None:
        tensors["encoder.reach"] = np.array([config.reach_m], np.float32)
    if config.num_tracks > 0:
        tensors["tracks"] = np.array([config.num_tracks, FOLLOWED_STEPS], np.float64)
    if config.path:
        tensors["encoder.path"] = PATH_POINTS_M
    if config.body:
        body = encoder.components["body"]
        assert isinstance(body, Body)
        tensors["encoder.body"] = body.numbers[0]
    for i, (weight, bias) in enumerate(policy.layers):
        tensors |= {f"layers.{i}.weight": weight, f"layers.{i}.bias": bias}
    return save(
        {name: np.ascontiguousarray(tensor) for name, tensor in tensors.items()}, metadata(policy, robot)
    )
