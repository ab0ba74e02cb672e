"""adrl train."""

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from adrl.agents.methods import method_name
from adrl.cli import STARTED_S
from adrl.commands.options import console, load_place, parse, progress_bar
from adrl.outputs import require_folder
from adrl.runs import RunConfig, run_folder, train

if TYPE_CHECKING:
    from adrl.agents.train import Progress

REDRAW_S = 0.1


def main(arguments: Sequence[str]) -> int:
    """Train a policy and say where it is."""
    config = parse(
        RunConfig, arguments, "train", "Train a policy. Distances in m, times in s, angles in rad."
    )
    require_folder("--out", config.out)
    last_drawn = 0.0
    scenario = load_place(config)
    with progress_bar(f"{method_name(config.method)} on {scenario.name}") as (bar, task):

        def show(progress: "Progress") -> None:
            nonlocal last_drawn
            now = time.monotonic()
            if now - last_drawn >= REDRAW_S or progress.fraction >= 1.0:
                last_drawn = now
                bar.update(task, completed=progress.fraction, note=_note(progress))

        result = train(config, on_progress=show, start_time_s=STARTED_S)
        bar.update(task, completed=1.0)
    console().print(
        f"{result.env_steps} environment steps, {result.updates} updates, {result.episodes} episodes in "
        f"{result.train_seconds:.1f} s"
    )
    print(run_folder(config, scenario))
    return 0


def _note(progress: "Progress") -> str:
    success = progress.success if progress.success is not None else progress.train_success
    percent = "" if success is None else f" success {100 * success:.0f} %"
    return (
        f"{progress.env_steps} steps S {progress.maturity:.2f} alpha {progress.alpha:.2f} "
        f"lambda {progress.lambda_bc:.2f}{percent}"
    )
