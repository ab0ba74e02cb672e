"""Rounds of demonstrations, in which a clone drives and the expert says what it would do there (DAgger).

Each round is a file, so that a run that is stopped goes on with the next one, to the same bytes:

  checkpoint/rounds/00.safetensors   what the expert drove
  checkpoint/rounds/01.safetensors   what the clone of that drove, and the clone; and so on
"""

import dataclasses
import itertools
import json
import time
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
from adrl.errors import AdrlError, CheckpointError, brief
from adrl.files import require_ordinary, sync
from adrl.imitation import Demonstrations, NoiseConfig, collect
from adrl.runs.run import Run
from adrl.signals import termination_interrupts

if TYPE_CHECKING:
    from adrl.agents.cloning import Clone

CLONING_UPDATES = 5_000
"""Of the clone in each round."""
LAST_UPDATES = 20_000
"""After the last one."""
LABELS = "2: without the planner's recovery"
"""What labels mean; rounds with others are not gone on with. Grows when experts answer otherwise without an option."""
CALM = NoiseConfig(fraction=0.3, std=0.2)
"""How a clone is pushed off its course: less than an expert, as it makes mistakes of its own."""
TASKS_APART = 1_000_003
"""Between the seeds of two rounds: other tasks, and other noise."""
FOLDER = "rounds"
ABOUT, SECONDS = "about", "seconds"
"""Metadata of a file: whose round it is, and the wall clock that it took."""
CLONE = "clone."
"""What the names of the clone's arrays begin with."""


@dataclass(frozen=True)
class Round:
    """What was driven, and the parameters and moments of the clone that drove; none in the first round."""

    shown: Demonstrations
    clone: dict[str, NDArray[Any]]
    seconds: float
    """Wall clock, the clone's fitting included."""


@dataclass(frozen=True)
class Outcome:
    """Of all rounds."""

    shown: Demonstrations
    clone: MlpPolicy
    seconds_before: float
    """Wall clock of the rounds that the folder held already."""


def exist(run: Path) -> bool:
    """Whether a run folder holds rounds to go on from."""
    return any((run / checkpoint.FOLDER / FOLDER).glob("*.safetensors"))


def demonstrate(run: Run, env: NavVectorEnv, tell: Callable[[str], None]) -> Outcome:
    """Drive the rounds of a run that its folder does not hold yet. tell(phase) is told what is done.

    Raises CheckpointError for rounds of another run, and TrainingStopped. In another simulator, where no run can be
    resumed, none is kept.
    """
    try:
        with termination_interrupts():
            return _demonstrate(run, env, tell)
    except KeyboardInterrupt:
        count = len(_files(run.folder))
        if count == 0:
            raise
        raise TrainingStopped(
            f"stopped with {count} rounds of demonstrations; the same command with --resume goes on from there "
            f"({run.folder})"
        ) from None


def _demonstrate(run: Run, env: NavVectorEnv, tell: Callable[[str], None]) -> Outcome:
    from adrl.agents.cloning import Clone

    learner, rounds = run.learner, run.config.demonstration_rounds
    steps = -(-run.demonstration_steps // (rounds + 1))
    about = _about(run, env.expert, steps)
    gathered = Gathered((rounds + 1) * -(-steps // env.num_envs) * env.num_envs)
    seconds_before, last = 0.0, None
    known = _files(run.folder)[: rounds + 1]
    for path in known:
        last = load(path, about)
        gathered.add(last.shown)
        seconds_before += last.seconds
    began_s = time.monotonic()

    def keep(number: int, shown: Demonstrations, clone: "Clone | None") -> None:
        nonlocal began_s
        state, seconds = {} if clone is None else clone.state(), time.monotonic() - began_s
        began_s += seconds
        if run.simulator is None:
            save(_file(run.folder, number), Round(shown, state, seconds), about)

    if last is None:
        driven = collect(env, steps, expert=run.expert, seed=learner.seed)
        keep(0, driven, None)
        gathered.add(driven)
    shown = gathered.shown()
    size, widths = shown.observation.shape[1], learner.td3.widths
    mirror = env.sim.encoder.mirror if learner.mirror else None
    clone = Clone(widths, size, mirror, np.random.default_rng((learner.seed, 2)))
    if last is not None and last.clone:
        clone.set_state(last.clone)
    first, last = max(len(known), 1), None
    config, arrived = replace(run.about_policy(), input_size=size, widths=widths), ""
    for number in range(first, rounds + 1):
        tell(f"demonstrations, round {number} of {rounds}{arrived}")
        clone.fit(shown, CLONING_UPDATES, _rng_of_round(learner.seed, number))
        seed, driver = learner.seed + number * TASKS_APART, clone.policy(config).act
        driven = collect(env, steps, expert=run.expert, noise=CALM, seed=seed, learner=driver)
        keep(number, driven, clone)
        ends = driven.success[driven.terminated]
        arrived = (
            f", the last clone arrived {int(ends.sum())} times and hit something {int((~ends).sum())} times"
        )
        gathered.add(driven)
        shown = gathered.shown()
    tell(f"demonstrations, last clone{arrived}")
    clone.fit(shown, LAST_UPDATES, _rng_of_round(learner.seed, rounds + 1), last=True)
    return Outcome(shown, clone.policy(config), seconds_before)


class Gathered:
    """What all rounds have shown, in arrays made once for all of it: to join them anew takes twice the memory."""

    def __init__(self, rows: int) -> None:
        """rows: of all rounds together."""
        self._rows, self._count = rows, 0
        self._columns: dict[str, NDArray[Any]] = {}

    def add(self, driven: Demonstrations) -> None:
        """A round more."""
        rows = slice(self._count, self._count + len(driven))
        for field in dataclasses.fields(driven):
            column = np.asarray(getattr(driven, field.name))
            column = np.broadcast_to(column, (len(driven), *column.shape[1:]))  # periods may be one for all
            if field.name not in self._columns:
                self._columns[field.name] = np.empty((self._rows, *column.shape[1:]), column.dtype)
            self._columns[field.name][rows] = column
        self._count += len(driven)

    def shown(self) -> Demonstrations:
        """All so far; no copy."""
        return Demonstrations(**{name: column[: self._count] for name, column in self._columns.items()})


def _about(run: Run, planner: str, steps: int) -> dict[str, Any]:
    """What rounds have to have in common, as JSON has it. More rounds of as many steps may follow later."""
    policy, td3 = run.about_policy(), run.learner.td3
    about = {
        "labels": LABELS,
        "robot": policy.robot,
        "family": policy.family,
        "encoder": policy.encoder,
        "environment": policy.extra["environment"],
        "reward": policy.extra["reward"],
        "method": policy.method,
        "expert": str(run.expert),
        "planner": planner,
        "demonstration_steps / (demonstration_rounds + 1)": steps,
        "seed": run.learner.seed,
        "mirror": run.learner.mirror,
        "widths": td3.widths,
    }
    return json.loads(json.dumps(about, default=str))


def _rng_of_round(seed: int, number: int) -> np.random.Generator:
    """Of a round's own, so that a clone is fitted to the same bytes after a stop."""
    return np.random.default_rng((seed, 2, number))


def _file(run: Path, number: int) -> Path:
    return run / checkpoint.FOLDER / FOLDER / f"{number:02}.safetensors"


def _files(run: Path) -> list[Path]:
    """Of the rounds, from the first up to one that is missing."""
    return list(itertools.takewhile(Path.exists, (_file(run, number) for number in itertools.count())))


def save(path: Path, one: Round, about: dict[str, Any]) -> None:
    """Write a round; a kill leaves it whole or not there. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = {
        field.name: np.asarray(getattr(one.shown, field.name)) for field in dataclasses.fields(one.shown)
    }
    arrays = columns | {CLONE + name: array for name, array in one.clone.items()}
    new = path.with_name(f".new-{path.name}")
    try:
        save_file(
            {name: np.asarray(array, order="C") for name, array in arrays.items()},
            new,
            {ABOUT: json.dumps(about), SECONDS: str(one.seconds)},
        )
        sync(new)
    except SafetensorError as error:  # what the library makes of a full disk
        new.unlink(missing_ok=True)
        raise OSError(None, f"cannot be written ({brief(error)})", str(path)) from None
    new.rename(path)
    sync(path.parent)


def load(path: Path, about: dict[str, Any]) -> Round:
    """A round that save() wrote. Raises CheckpointError for a bad file, and for one of another run."""
    try:
        require_ordinary(path)
        with safe_open(path, "numpy") as file:
            metadata = file.metadata() or {}
            saved, seconds = json.loads(metadata[ABOUT]), float(metadata[SECONDS])
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
        columns = {name: array for name, array in arrays.items() if not name.startswith(CLONE)}
        clone = {name.removeprefix(CLONE): arrays[name] for name in arrays.keys() - columns.keys()}
        shown = Demonstrations(**columns)
        if bool(clone) == (path.name == _file(path, 0).name):
            raise ValueError("the first round has no clone, and the others one each")
    except (OSError, SafetensorError, ValueError, KeyError, TypeError, IndexError, AdrlError) as error:
        raise CheckpointError(
            f"{path}: truncated, or not a round of demonstrations ({brief(error)}); delete it and those after it, and "
            "they are driven again"
        ) from None
    checkpoint.require_same(path, saved, about, "run")
    return Round(shown, clone, seconds)
