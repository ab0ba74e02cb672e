"""Back from an observation to metres, within what a sector keeps; and measurements side by side."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from adrl.observation import EncoderConfig, Measurements, ObservationDecoder, ObservationEncoder
from adrl.observation.motion import ScanHistory
from adrl.types import RobotConfig
from adrl.worlds import ROBOTS
from observation.test_encoder import robots, seeds

configs = st.builds(
    EncoderConfig,
    num_sectors=st.integers(4, 72),
    near_m=st.floats(0.05, 2.0),
    goal_scale_m=st.floats(0.2, 5.0),
    history_steps=st.integers(0, 3),
)


def measured(robot: RobotConfig, config: EncoderConfig, seed: int):
    """Ranges, goals, twists, last actions and a history of five robots; the first stands on its goal."""
    rng = np.random.default_rng(seed)
    lidar = robot.lidar
    ranges, past = rng.uniform(0.0, lidar.max_range_m, (2, 5, lidar.num_beams)).astype(np.float32)
    goal = rng.normal(size=(5, 2)) * 10.0 ** rng.uniform(-2.0, 2.0, (5, 1))
    goal[0] = 0.0
    twist = rng.uniform(-1.0, 1.0, (5, 2)) * [robot.max_speed_mps, robot.max_yaw_rate_radps]
    action = rng.uniform(-1.0, 1.0, (5, 2)).astype(np.float32)
    history = None
    if config.history_steps:
        history = ScanHistory(5, lidar.num_beams, config.history_steps)
        history.begin(np.arange(5), past, rng.normal(size=(5, 3)))
        for _ in range(config.history_steps):
            history.add(ranges, rng.normal(size=(5, 3)))
    return ranges, goal, twist, action, history


@given(robots, configs, seeds)
def test_decoding_is_the_inverse_of_encoding(robot: RobotConfig, config: EncoderConfig, seed: int):
    assume(robot.lidar.num_beams > 1 or config.history_steps == 0)  # motion cues compare neighbouring beams
    encoder, decoder = ObservationEncoder(robot, config), ObservationDecoder(robot, config)
    ranges, goal, twist, action, history = measured(robot, config, seed)
    seen = encoder.encode(ranges, goal, twist, action, history)
    told = decoder.decode(seen)
    # A sector keeps its nearest beam, and nothing nearer than the footprint's edge.
    padded = np.concatenate([ranges, np.full((5, 1), robot.lidar.max_range_m, np.float32)], axis=1)
    nearest = padded[:, encoder.beams_of_sectors].min(axis=2)
    expected = np.maximum(nearest, encoder.extent_m)
    np.testing.assert_allclose(told.ranges, expected, atol=1e-5 * (robot.lidar.max_range_m + config.near_m))
    # float32 leaves of a distance d on the near scale d / (d + 1) an error of some d^2.
    error = 1e-5 + 4e-7 * np.hypot(*goal.T) ** 2 / config.goal_scale_m
    assert (np.hypot(*(told.goal - goal).T) <= error + 1e-6 * np.hypot(*goal.T)).all()
    np.testing.assert_allclose(told.twist, twist, atol=1e-6)
    np.testing.assert_array_equal(told.last_action, action)
    # Encoding what was decoded gives the same observation: nothing else is in it.
    again = encoder.encode(ranges, told.goal, told.twist, told.last_action.astype(np.float32), history)
    np.testing.assert_allclose(again, seen, atol=2e-5)
    assert told.motion.shape == (5, config.num_sectors if config.history_steps else 0)


def test_sectors_point_where_the_decoder_says():
    robot = RobotConfig()
    decoder, encoder = ObservationDecoder(robot), ObservationEncoder(robot)
    ranges = np.full((1, 180), 6.0, np.float32)
    ranges[0, 135] = 1.0  # the beam at 90 degrees
    zeros = np.zeros((1, 2))
    told = decoder.decode(encoder.encode(ranges, zeros, zeros, zeros.astype(np.float32)))
    hit = np.flatnonzero(told.ranges[0] < 2.0)
    np.testing.assert_allclose(decoder.angles_rad[hit].mean(), 0.5 * np.pi, atol=1e-6)
    np.testing.assert_allclose(told.ranges[0, hit], 1.0, atol=1e-5)


@pytest.mark.parametrize("shape", [(44,), (3, 43), (3, 45)])
def test_other_shapes_are_refused(shape: tuple[int, ...]):
    with pytest.raises(ValueError, match=r"give \(N, 44\)"):
        ObservationDecoder(RobotConfig()).decode(np.zeros(shape))


@pytest.mark.parametrize("steps", [0, 2])
def test_measurements_are_taken_apart_as_they_were(steps: int):
    robot, config = ROBOTS["jackal"], EncoderConfig(history_steps=steps)
    ranges, goal, twist, action, history = measured(robot, config, seed=1)
    measurements = Measurements(steps)
    told = measurements.split(measurements.encode(ranges, goal, twist, action, history))
    np.testing.assert_array_equal(told.ranges, ranges)
    np.testing.assert_allclose(told.goal, goal, rtol=1e-7)
    np.testing.assert_array_equal(told.last_action, action)
    if history is None:
        assert (told.past_ranges.shape, told.pose.shape, told.past_pose.shape) == ((5, 0), (5, 0), (5, 0))
    else:
        newest, pose, oldest, past_pose = history.ends()
        np.testing.assert_array_equal(told.ranges, newest)
        for found, expected in ((told.past_ranges, oldest), (told.pose, pose), (told.past_pose, past_pose)):
            np.testing.assert_array_equal(found, expected)
