"""Rounds of demonstrations, in which a clone drives and the expert says what it would do there (DAgger).

Each round is a file, so that a run that is stopped goes on with the next one, to the same bytes:

  checkpoint/rounds/00.safetensors   what the expert drove
  checkpoint/rounds/01.safetensors   what the clone of that drove, and the clone; and so on
"""

import dataclasses
import itertools
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from adrl.agents import checkpoint
from adrl.agents.interface import TrainingStopped
from adrl.deploy.policy import MlpPolicy
from adrl.envs import NavVectorEnv
from adrl.errors import CheckpointError, brief
from adrl.files import sync
from adrl.imitation import Demonstrations, NoiseConfig, collect
from adrl.runs.run import Run

if TYPE_CHECKING:
    from adrl.agents.cloning import Clone

CLONING_UPDATES = 5_000
"""Of the clone in each round; twice as many after the last."""
CALM = NoiseConfig(fraction=0.3, std=0.2)
"""How a clone is pushed off its course: less than an expert, as it makes mistakes of its own."""
TASKS_APART = 1_000_003
"""Between the seeds of two rounds: other tasks, and other noise."""
FOLDER = "rounds"
ABOUT, CLONE = "about", "clone."
"""The metadata that says whose round a file is; what the names of the clone's arrays begin with."""


@dataclass(frozen=True)
class _Round:
    """What was driven, and the parameters and moments of the clone that drove; none in the first round."""

    shown: Demonstrations
    clone: dict[str, NDArray[Any]]


def exist(run: Path) -> bool:
    """Whether a run folder holds rounds to go on from."""
    return bool(_files(run))


def demonstrate(run: Run, env: NavVectorEnv, tell: Callable[[str], None]) -> tuple[Demonstrations, MlpPolicy]:
    """All that is shown in the rounds of a run, those that its folder holds among them, and the clone of it.

    tell(phase) is told what is done. Raises CheckpointError for rounds of another run, and TrainingStopped.
    """
    try:
        return _demonstrate(run, env, tell)
    except KeyboardInterrupt:
        if not exist(run.folder):
            raise
        raise TrainingStopped(
            f"stopped with {len(_files(run.folder))} rounds of demonstrations; the same command with --resume goes on "
            f"from there ({run.folder})"
        ) from None


def _demonstrate(
    run: Run, env: NavVectorEnv, tell: Callable[[str], None]
) -> tuple[Demonstrations, MlpPolicy]:
    from adrl.agents.cloning import Clone

    learner, rounds = run.learner, run.config.demonstration_rounds
    steps = -(-run.demonstration_steps // (rounds + 1))
    about = _about(run, env.expert, steps)
    kept = [_load(path, about) for path in _files(run.folder)[: rounds + 1]]
    if not kept:
        kept.append(_Round(collect(env, steps, expert=run.expert, seed=learner.seed), {}))
        _save(run.folder, 0, kept[0], about)
    shown = kept[0].shown
    for later in kept[1:]:
        shown = shown.followed_by(later.shown)

    size, widths = shown.observation.shape[1], learner.td3.widths
    mirror = env.sim.encoder.mirror if learner.mirror else None
    clone = Clone(learner.td3, size, mirror, np.random.default_rng((learner.seed, 2)))
    if kept[-1].clone:
        clone.set_state(kept[-1].clone)
    config = replace(run.about_policy(), input_size=size, widths=widths)
    arrived = ""
    for number in range(len(kept), rounds + 1):
        tell(f"demonstrations, round {number} of {rounds}{arrived}")
        _fit(clone, shown, learner.seed, number)
        seed, driver = learner.seed + number * TASKS_APART, clone.policy(config).act
        driven = collect(env, steps, expert=run.expert, noise=CALM, seed=seed, learner=driver)
        arrived = f", {100 * driven.success[driven.ended].mean():.1f} % of the last one's drives arrived"
        _save(run.folder, number, _Round(driven, clone.state()), about)
        shown = shown.followed_by(driven)
    tell(f"demonstrations, last clone{arrived}")
    _fit(clone, shown, learner.seed, rounds + 1, calls=2)
    return shown, clone.policy(config)


def _about(run: Run, planner: str, steps: int) -> dict[str, Any]:
    """What rounds have to have in common, as JSON has it. More rounds of as many steps may follow later."""
    policy, td3 = run.about_policy(), run.learner.td3
    about = {
        "robot": policy.robot,
        "family": policy.family,
        "encoder": policy.encoder,
        "environment": policy.extra["environment"],
        "expert": str(run.expert),
        "planner": planner,
        "steps_a_round": steps,
        "seed": run.learner.seed,
        "mirror": run.learner.mirror,
        "widths": td3.widths,
        "actor_learning_rate": td3.actor_learning_rate,
    }
    return json.loads(json.dumps(about))


def _fit(clone: "Clone", shown: Demonstrations, seed: int, number: int, calls: int = 1) -> None:
    """Fitted with a stream of the round's own, so that it is the same after a stop."""
    clone.fit(shown, calls * CLONING_UPDATES, np.random.default_rng((seed, 2, number)))


def _file(run: Path, number: int) -> Path:
    return run / checkpoint.FOLDER / FOLDER / f"{number:02}.safetensors"


def _files(run: Path) -> list[Path]:
    """Of the rounds, from the first up to one that is missing."""
    return list(itertools.takewhile(Path.exists, (_file(run, number) for number in itertools.count())))


def _save(run: Path, number: int, one: _Round, about: dict[str, Any]) -> None:
    path = _file(run, number)
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = {
        field.name: np.asarray(getattr(one.shown, field.name)) for field in dataclasses.fields(one.shown)
    }
    arrays = columns | {CLONE + name: array for name, array in one.clone.items()}
    new = path.with_name(f".new-{path.name}")
    save_file(
        {name: np.ascontiguousarray(array) for name, array in arrays.items()}, new, {ABOUT: json.dumps(about)}
    )
    sync(new)
    new.rename(path)


def _load(path: Path, about: dict[str, Any]) -> _Round:
    try:
        with safe_open(path, "numpy") as file:
            saved = json.loads((file.metadata() or {})[ABOUT])
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
        columns = {name: array for name, array in arrays.items() if not name.startswith(CLONE)}
        clone = {name.removeprefix(CLONE): arrays[name] for name in arrays.keys() - columns.keys()}
        one = _Round(Demonstrations(**columns), clone)
    except (OSError, SafetensorError, ValueError, KeyError, TypeError) as error:
        raise CheckpointError(
            f"{path}: truncated, or not a round of demonstrations ({brief(error)}); delete it, and it is driven again"
        ) from None
    checkpoint.require_same(path, saved, about)
    return one
