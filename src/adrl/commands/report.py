"""adrl report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from adrl import api
from adrl.commands.options import parse
from adrl.commands.progress import console, counting_bar
from adrl.deploy.policy import CONFIG_FILE, WEIGHTS_FILE
from adrl.errors import CheckpointError, ConfigError, FileError
from adrl.outputs import require_file
from adrl.report.html import plotly_script, write_report
from adrl.report.paper import paper_figures
from adrl.report.source import evaluation_folders, read_run, read_source
from adrl.worlds.place import Place


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """What to report."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Of a training run, of a comparison, or of an evaluation (adrl evaluate --out)."""
    episodes: int = 200
    """Test tasks to drive first where a finished run has no evaluation in its folder. For others, leave them there:
    adrl evaluate --policy RUN --map MAP --out RUN/NAME."""
    out: Path | None = None
    """The HTML file; report.html in the folder when left out."""
    figures: bool = False
    """Also write figures for papers, PNG and PDF, to figures/ beside the HTML file."""


def main(arguments: Sequence[str]) -> int:
    """Evaluate where nothing was, write the page, and say where it is."""
    options = parse(
        ReportOptions,
        arguments,
        "report",
        "One HTML file that needs no server: curves, tables, replays, failures, and where on a map they happen.",
    )
    require_file("--out", options.out)
    if options.episodes < 1:
        raise ConfigError(f"episodes is {options.episodes}; give 1 or more")
    plotly_script()  # is there: an evaluation would be wasted
    folder = options.folder
    if (folder / WEIGHTS_FILE).exists() and not evaluation_folders(folder):
        _evaluate(folder, options.episodes)
    source = read_source(folder)
    out = options.out or folder / "report.html"
    write_report(source, out)
    for entry in source.evaluations:
        if entry.traces is None:
            console().print(f"{entry.label}: kept no traces, so there is no replay of it; evaluate it again")
    print(out)
    if options.figures:
        for path in paper_figures(source, out.parent / "figures"):
            print(path)
    return 0


def _evaluate(run: Path, episodes: int) -> None:
    """On test tasks of the place where the policy was trained."""
    try:
        place = Place.of(read_run(run).get("settings", {}))
    except FileError as error:
        raise CheckpointError(f"{run / CONFIG_FILE}: settings {error}; restore the file") from None
    with counting_bar(f"evaluating {run}", "episodes") as show:
        api.evaluate(run, scenario=place.load(), episodes=episodes, out=run / "evaluation", on_step=show)
