"""adrl collect."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from adrl.commands.options import console, parse, require_folder
from adrl.envs import NavVectorEnv
from adrl.errors import ConfigError
from adrl.imitation import Source, collect, save_minari
from adrl.worlds.place import Place


@dataclass(frozen=True, kw_only=True)
class CollectOptions(Place):
    """What to record."""

    out: Path
    """Folder of the new Minari dataset."""
    robot: str = "diffbot"
    """A robot's name (adrl list) or a TOML file."""
    guidance: Literal["goal", "replan", "map"] = "goal"
    """What the observations show: the final goal (replan: a waypoint of its own when stuck), or one on the A* path."""
    steps: int = 20_000
    """Environment steps to record."""
    seed: int = 0
    """Of tasks, noise and robots."""
    num_envs: int = 64
    """Robots driven side by side."""


def main(arguments: Sequence[str]) -> int:
    """Record demonstrations."""
    options = parse(CollectOptions, arguments, "collect", "Record A*+DWA demonstrations as a Minari dataset.")
    require_folder("--out", options.out)
    if options.seed < 0:
        raise ConfigError(f"seed is {options.seed}; give 0 or more")
    env = NavVectorEnv(
        options.num_envs,
        scenario=options.load(),
        robot=options.robot,
        guidance=options.guidance,
        seed=options.seed,
    )
    demonstrations = collect(env, options.steps, seed=options.seed)
    save_minari(demonstrations, options.out, Source.of(env, seed=options.seed))
    console().print(f"{len(demonstrations.terminated)} steps, {int(demonstrations.success.sum())} arrivals")
    print(options.out)
    return 0
