"""Components of the observation: each in its place, those from outside too."""

import dataclasses
import json
from importlib.metadata import EntryPoint
from typing import ClassVar

import numpy as np
import pytest

from adrl import registry
from adrl.envs import NavVectorEnv
from adrl.errors import ConfigError, UnknownName
from adrl.observation import COMPONENTS, EncoderConfig, Mirror, ObservationEncoder, Senses
from adrl.types import RobotConfig


class Openness:
    """How far the LiDAR sees on the average, of its reach; and to which side it sees farther."""

    name: ClassVar = "openness"
    size, limit = 2, 1.0

    def __init__(self, robot: RobotConfig, config: EncoderConfig) -> None:
        self._lidar = robot.lidar

    def write(self, senses: Senses, out: np.ndarray) -> None:
        share = senses.ranges / self._lidar.max_range_m
        out[:, 0] = share.mean(axis=1)
        out[:, 1] = (share * np.sign(self._lidar.angles_rad)).mean(axis=1)

    def mirror(self) -> Mirror | None:
        return Mirror(np.arange(2), np.array([1.0, -1.0], np.float32))


OPEN = EncoderConfig(history_steps=2, path=True, extra_components=(Openness,))


def test_components_stand_side_by_side_and_fill_the_observation() -> None:
    encoder = ObservationEncoder(RobotConfig(), dataclasses.replace(OPEN, body=True, num_tracks=2, path=True))
    assert list(encoder.components) == [*COMPONENTS, "openness"]
    ends = [0]
    for name, component in encoder.components.items():
        assert encoder.places[name] == slice(ends[-1], ends[-1] + component.size)
        ends.append(ends[-1] + component.size)
    assert ends[-1] == encoder.size


def test_a_component_from_outside_leaves_the_others_as_they_are() -> None:
    env = NavVectorEnv(3, scenario="clutter", task_pool=4, encoder=OPEN, seed=1)
    seen, _ = env.reset(seed=1)
    plain = NavVectorEnv(
        3, scenario="clutter", task_pool=4, encoder=EncoderConfig(history_steps=2, path=True), seed=1
    )
    np.testing.assert_array_equal(seen[:, :-2], plain.reset(seed=1)[0])
    np.testing.assert_allclose(seen[:, -2], env.sim.b["ranges"].mean(axis=1) / 6.0, rtol=1e-5)


def test_its_mirror_joins_the_others() -> None:
    encoder = ObservationEncoder(
        RobotConfig(lidar=dataclasses.replace(RobotConfig().lidar, noise_std_m=0.0)), OPEN
    )
    assert encoder.mirror is not None
    assert sorted(encoder.mirror.order) == list(range(encoder.size))
    assert encoder.mirror.sign[-1] == -1.0
    np.testing.assert_array_equal(encoder.mirror.order[-2:], [encoder.size - 2, encoder.size - 1])


def test_observing_some_rows_is_observing_all_and_picking_them() -> None:
    env = NavVectorEnv(6, scenario="clutter", task_pool=4, encoder=OPEN, seed=1)
    env.reset(seed=2)
    for _ in range(4):
        env.step(env.action_space.sample())
    rows = np.array([4, 0, 5])
    np.testing.assert_array_equal(env.sim.observe(rows), env.sim.observe()[rows])


def test_a_component_is_stored_by_name_and_found_by_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    fields = json.loads(json.dumps(OPEN.fields()))
    assert fields["extra_components"] == ["openness"]
    assert "extra_components" not in EncoderConfig().fields(), "policies of before say the same"
    with pytest.raises(UnknownName, match="openness"):
        ObservationEncoder(RobotConfig(), EncoderConfig(**fields))
    group = "adrl.observation_components"
    offered = [EntryPoint("openness", f"{__name__}:Openness", group)]
    monkeypatch.setattr(
        registry, "entry_points", lambda *, group: offered if group == offered[0].group else []
    )
    monkeypatch.setattr(EntryPoint, "load", lambda point: Openness)
    assert (
        ObservationEncoder(RobotConfig(), EncoderConfig(**fields)).size
        == ObservationEncoder(RobotConfig(), OPEN).size
    )


def test_what_is_no_component_is_refused() -> None:
    with pytest.raises(ConfigError, match="factories with a name"):
        EncoderConfig(extra_components=(3,))  # pyright: ignore[reportArgumentType]
    with pytest.raises(ConfigError, match="'openness' is there twice"):
        ObservationEncoder(RobotConfig(), EncoderConfig(extra_components=(Openness, Openness)))
