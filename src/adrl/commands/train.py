"""adrl train."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from adrl import extras
from adrl.agents.methods import method_name
from adrl.cli import STARTED_S
from adrl.commands.options import load_places, tell_guidance
from adrl.commands.progress import console, progress_bar
from adrl.commands.run_options import parse_run
from adrl.errors import CheckpointError, FileError
from adrl.json_files import read_json
from adrl.outputs import require_folder
from adrl.runs import RunConfig, train
from adrl.runs.record import PLANNER
from adrl.runs.train import VERSIONS_FILE

if TYPE_CHECKING:
    from adrl.agents.interface import Progress

COMMON = (
    *("scenario", "map", "world", "robot", "method", "guidance"),
    *("steps", "max_seconds", "seed", "out", "resume"),
)
"""What help shows first."""


def main(arguments: Sequence[str]) -> int:
    """Train a policy and say where it is."""
    config = parse_run(
        RunConfig,
        arguments,
        "train",
        "Train a policy. Distances in m, times in s, angles in rad.",
        COMMON,
    )
    extras.require("train", "training")
    require_folder("--out", config.out)
    scenarios = load_places(config)
    if not config.resume:  # what the run folder says holds
        tell_guidance(config, config.guidance)
    with progress_bar(
        f"{method_name(config.chosen_method)} on {', '.join(each.name for each in scenarios)}"
    ) as show:
        result = train(
            config,
            on_progress=lambda progress: show(progress.fraction, _note(progress), progress.phase),
            start_time_s=STARTED_S,
        )
    console().print(
        f"{result.env_steps} environment steps, {result.updates} updates, {result.episodes} episodes in "
        f"{result.train_seconds:.1f} s"
    )
    scores = result.policy.config.extra.get("validated")
    if scores is not None:
        console().print(_kept(scores))
    planner = _demonstrator(result.folder)
    if planner is not None:
        console().print(f"demonstrated by {planner}")
    print(result.folder)
    return 0


def _demonstrator(run: Path) -> str | None:
    """Which planner demonstrated, where the run says so. Raises CheckpointError."""
    path = run / VERSIONS_FILE
    if not path.exists():
        return None
    try:
        return read_json(path, dict[str, str]).get(PLANNER)
    except FileError as error:
        raise CheckpointError(
            f"{path} {error}; the policy is trained and does not need it: delete the file"
        ) from None


def _kept(scores: Mapping[str, Mapping[str, float]]) -> str:
    """Which policy is left of a run that began with one, and why."""

    def told(score: Mapping[str, float]) -> str:
        return f"{100 * score['success']:.1f} % in {score['seconds']:.1f} s a task"

    start, kept = scores["start"], scores["kept"]
    which = f"that of step {kept['env_steps']}" if kept["env_steps"] else "the one it began with"
    return f"validation: {told(start)} to begin with, {told(kept)} at best; kept {which}"


def _note(progress: "Progress") -> str:
    if progress.env_steps == 0:
        return ""
    success = progress.success if progress.success is not None else progress.train_success
    percent = "" if success is None else f" success {100 * success:.0f} %"
    return (
        f"{progress.env_steps} steps S {progress.maturity:.2f} alpha {progress.alpha:.2f} "
        f"lambda {progress.lambda_bc:.2f}{percent}"
    )
