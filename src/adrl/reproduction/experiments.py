"""What `adrl reproduce` runs: the places of section IV, each a comparison, in two sizes."""

from dataclasses import replace

from adrl.agents.config import TrainConfig
from adrl.comparison.config import CompareConfig
from adrl.errors import ConfigError
from adrl.registry import listed_option, look_up
from adrl.reproduction.reported import CLASSICAL, METHODS
from adrl.simulators import NATIVE

GAZEBO = "gazebo"
ROUTES = 3
"""Test tasks whose routes are drawn (Fig. 7)."""
SIZES = {"quick": (2, 20, 10), "full": (10, 200, 40)}
"""Preset -> seeds, test tasks, validation tasks."""
QUICK_STEPS = 8192
GAZEBO_SEEDS, GAZEBO_METHODS, GAZEBO_ENVS = 5, "adrl,td3,rl-bc,td3bc", 16
"""Steps are dear there: half the seeds, the methods of our learner, and more updates a step, as fewer robots share
them. A gzserver with the worlds of 64 robots takes 2.3 GB."""


def preset(name: str) -> dict[str, CompareConfig]:
    """Place -> its comparison, of the preset quick or full, in the order in which they are run.

    As in the paper policies see the goal and no map, the replanner is off in training, and every policy is then driven
    without and with it. The Jackal, at 2 m/s, is trained on the known map, and driven on it and without it. In Gazebo
    policies are trained as the paper's were, from nothing, and then driven on the tasks of `hall` like all others.
    Within a place all methods have the same budget of environment steps.
    """
    seeds, episodes, validation = SIZES[name]

    def place(steps: int, scenario: str, robot: str = "diffbot", guidance: str = "goal") -> CompareConfig:
        steps = steps if name == "full" else QUICK_STEPS
        return CompareConfig(
            scenario=scenario,
            robot=robot,
            methods=",".join(METHODS),
            policies=",".join(CLASSICAL),
            seeds=seeds,
            episodes=episodes,
            guidance=guidance,
            eval_guidance=f"{guidance},replan",
            validation_episodes=validation,
            routes=ROUTES,
            keep_checkpoints=False,
            learner=TrainConfig(
                steps=steps,
                log_interval_steps=min(steps // 16, 4096),
                eval_interval_steps=min(steps // 4, 16_384),
            ),
        )

    in_gazebo = replace(
        place(65_536, "hall"),
        env="gazebo",
        num_envs=GAZEBO_ENVS,
        methods=GAZEBO_METHODS,
        seeds=min(seeds, GAZEBO_SEEDS),
    )
    return {
        "clutter": place(262_144, "clutter"),
        "hall": place(131_072, "hall"),
        "complex": place(262_144, "complex"),
        "complex-jackal": place(131_072, "complex", "jackal", "map"),
        GAZEBO: in_gazebo,
    }


def chosen(places: str, comparisons: dict[str, CompareConfig]) -> dict[str, CompareConfig]:
    """The comparisons of these places, names with commas between; all of them where none is named.

    Of those not named, the ones whose simulator is not set up here are left out. Raises UnknownName, and ConfigError
    for one that is named, or where a text names none.
    """
    names = listed_option("places", places) if places else ()
    for name in names:
        look_up("place", name, comparisons)
    if not names:
        return {name: config for name, config in comparisons.items() if _is_set_up(config)}
    for name in names:
        if not _is_set_up(comparisons[name]):
            raise ConfigError(f"place {name!r} needs Gazebo, which is not set up; run scripts/gazebo-chroot")
    return {name: comparisons[name] for name in names}


def _is_set_up(config: CompareConfig) -> bool:
    from adrl.integrations.gazebo.server import is_installed

    return config.env == NATIVE or is_installed()
