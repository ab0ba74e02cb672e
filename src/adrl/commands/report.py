"""adrl report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from adrl import api
from adrl.commands.options import parse
from adrl.commands.progress import console, counting_bar
from adrl.deploy.policies import find_policy
from adrl.deploy.policy import CONFIG_FILE, WEIGHTS_FILE
from adrl.errors import CheckpointError, ConfigError, FileError
from adrl.outputs import require_file
from adrl.report.html import write_report
from adrl.report.paper import paper_figures
from adrl.report.source import (
    evaluation_folders,
    outdated,
    read_run,
    read_source,
    read_summary,
    robot_of_run,
)
from adrl.types import SPLITS, Scenario
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
    folder = options.folder
    out = options.out or folder / "report.html"
    require_file("--out", out)
    if options.episodes < 1:
        raise ConfigError(f"episodes is {options.episodes}; give 1 or more")
    if (folder / WEIGHTS_FILE).exists():
        _evaluate_anew(folder, options.episodes)
    source = read_source(folder)
    write_report(source, out)
    for entry in source.evaluations:
        if entry.traces is None:
            console().print(f"{entry.label}: kept no traces, so there is no replay of it; evaluate it again")
    print(out)
    if options.figures:
        for path in paper_figures(source, out.parent / "figures"):
            print(path)
    return 0


def _evaluate_anew(run: Path, episodes: int) -> None:
    """Where nothing was evaluated, on test tasks of each place of training; what is of an earlier policy, as it was."""
    config = read_run(run)
    try:
        place = Place.of(config.get("settings", {}))
    except FileError as error:
        raise CheckpointError(f"{run / CONFIG_FILE}: settings {error}; restore the file") from None
    found, stale = evaluation_folders(run), outdated(run)
    several = place.first != place
    # Read where it is needed: the map may have been moved.
    places = {one.name: one for one in place.load_all()} if several or stale or not found else {}
    own = {run / ("evaluation" if len(places) == 1 else f"evaluation-{name}"): name for name in places}
    if own.keys() >= set(found):  # nobody else's: none, or those of a report that was killed
        for folder, name in own.items():
            if folder not in found:
                _evaluate(run, places[name], folder, {"episodes": episodes})
    for folder in stale:
        summary = read_summary(folder)
        trained = {"robot": robot_of_run(config), "simulator": "native"}
        as_trained = {key: summary.get(key, "native") for key in trained} == trained
        if as_trained and summary.get("scenario") in places and summary["split"] in SPLITS:
            as_before = ("split", "guidance", "episodes", "paper_literal", "supervised")
            _evaluate(
                run,
                places[summary["scenario"]],
                folder,
                {key: summary[key] for key in as_before if key in summary},
            )
        else:
            console().print(
                f"{folder} is left out: it is of the policy before it was trained for longer; evaluate it again"
            )


def _evaluate(run: Path, scenario: Scenario, out: Path, options: dict[str, Any]) -> None:
    family = find_policy(run).family
    with counting_bar(f"evaluating {run}", "episodes") as show:
        given = {"scenario": scenario, "out": out, "on_step": show} | options
        if family is None:
            api.evaluate(run, **given)
        else:
            given |= {"robots": max(1, given["episodes"] // api.TASKS), "episodes": api.TASKS}
            for name in ("paper_literal", "supervised"):
                given.pop(name, None)
            api.evaluate_family(run, family=family, **given)
