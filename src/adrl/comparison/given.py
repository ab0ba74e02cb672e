"""What stands in the files that a comparison is given, told apart by content: a file may change between two calls."""

from hashlib import sha256
from pathlib import Path

import numpy as np

from adrl.deploy.policy import load_policy, resolve_policy
from adrl.runs import RunConfig
from adrl.types import Scenario, World
from adrl.worlds import BarnScenario
from adrl.worlds.fixed import FixedWorld
from adrl.worlds.given import fingerprint
from adrl.worlds.people import Peopled


def fingerprints(config: RunConfig) -> dict[str, str]:
    """Of the worlds, of the dataset and of the policy to fine-tune, by these names; of what is given alone.

    A dataset that is not there has none: the run that wants it says so. Raises AdrlError.
    """
    found = {}
    if any(given is not None for given in (config.map, config.world, config.barn)):
        found["worlds"] = _of_worlds(config.load())
    if config.dataset is not None and config.dataset.is_dir():
        found["dataset"] = _of_folder(config.dataset)
    if config.fine_tune is not None:
        found["fine_tune"] = load_policy(resolve_policy(config.fine_tune)).fingerprint
    return found


def _of_worlds(scenario: Scenario) -> str:
    """In their order, which is that of the tasks."""
    place = scenario.place if isinstance(scenario, Peopled) else scenario
    worlds = [place.world] if isinstance(place, FixedWorld) else []
    worlds += [barn.world for barn in place.worlds] if isinstance(place, BarnScenario) else []
    return _of(*map(_of_world, worlds))


def _of_world(world: World) -> bytes:
    """Fingerprint knows neither the bounds nor a map's cells."""
    parts = [fingerprint(world).encode(), _rounded(*world.bounds)]
    if (grid := world.grid) is not None:
        parts += [_rounded(*grid.origin, grid.resolution_m), f"{grid.solid.shape}".encode()]
        parts += [cells.tobytes() for cells in (grid.solid, grid.observed_free) if cells is not None]
    return b"|".join(parts)


def _rounded(*numbers: float) -> bytes:
    """To a millionth: machines may differ beyond."""
    return np.rint(1e6 * np.array(numbers)).astype("<i8").tobytes()


def _of_folder(folder: Path) -> str:
    """Names and contents of all files in it."""
    parts = []
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        with open(path, "rb") as stream:
            content = sha256()
            while block := stream.read(2**20):
                content.update(block)
        parts.append(f"{path.relative_to(folder)} {content.hexdigest()}".encode())
    return _of(*parts)


def _of(*parts: bytes) -> str:
    return sha256(b"\n".join(parts)).hexdigest()[:16]
