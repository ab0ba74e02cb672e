"""A small recording and its dataset, which the tests of Minari share."""

from pathlib import Path

import pytest

from adrl.envs import NavVectorEnv
from adrl.imitation import Demonstrations, Source, collect, save_minari


@pytest.fixture(scope="session")
def env() -> NavVectorEnv:
    return NavVectorEnv(8, task_pool=16, robot="turtlebot3_burger", guidance="map")


@pytest.fixture(scope="session")
def recorded(env: NavVectorEnv) -> Demonstrations:
    return collect(env, 2400, seed=1)


@pytest.fixture
def dataset(recorded: Demonstrations, env: NavVectorEnv, tmp_path: Path) -> Path:
    path = tmp_path / "burger-v3"
    save_minari(recorded, path, Source.of(env, seed=1))
    return path
