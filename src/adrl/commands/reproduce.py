"""adrl reproduce."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from adrl.commands.options import parse
from adrl.commands.progress import console, job_bar
from adrl.errors import ConfigError
from adrl.outputs import require_folder
from adrl.reproduction.reproduce import preset, reproduce
from adrl.reproduction.tables import PAGE_FILE, write_report

RESULTS_FOLDER = "results"


@dataclass(frozen=True, kw_only=True)
class ReproduceOptions:
    """One of --quick and --full."""

    quick: bool = False
    """2 seeds and short runs, some minutes on 2 cores: shows that everything works, proves nothing."""
    full: bool = False
    """10 seeds of every method in both scenarios, up to 3 hours on 2 cores."""
    out: Path | None = None
    """Folder of the runs; runs/reproduce-quick or -full when left out."""
    results: Path | None = None
    """Folder of the figures, the tables and the small files that they are made from; OUT/results when left out. With
    these files alone, OUT gone, the same command does what is missing."""
    tables_only: bool = False
    """Run nothing: figures and tables of the jobs that have ended so far."""
    workers: int = 0
    """Processes, each on a core of its own; 0 takes one for every usable core."""
    ray: str | None = None
    """Address of a Ray cluster, HOST:PORT, that runs the jobs instead of processes here, one for each of its CPUs."""


def main(arguments: Sequence[str]) -> int:
    """Run what is missing, draw and write everything, and say which jobs failed."""
    options = parse(
        ReproduceOptions,
        arguments,
        "reproduce",
        "Run the paper's section IV again: every method with every seed in two scenarios, its figures and Table I, and "
        "beside them what tells more. The same command again goes on where it was stopped.",
    )
    if options.quick == options.full:
        raise ConfigError("give one of --quick and --full")
    name = "full" if options.full else "quick"
    out = options.out or Path("runs") / f"reproduce-{name}"
    results = options.results or out / RESULTS_FOLDER
    require_folder("--out", out)
    require_folder("--results", results)
    comparisons = {
        scenario: replace(config, workers=options.workers, ray=options.ray)
        for scenario, config in preset(name).items()
    }
    failed: dict[str, Path] = {}
    if not options.tables_only:
        with job_bar("reproducing") as show:
            failed = reproduce(comparisons, out, results, name=name, on_change=show)
    for job, log in failed.items():
        console().print(f"failed: {job}, see {log}", style="red")
    write_report(results)
    print(results / PAGE_FILE)
    return 1 if failed else 0
