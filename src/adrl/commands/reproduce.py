"""adrl reproduce."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from adrl.commands.options import parse
from adrl.commands.progress import console, job_bar
from adrl.errors import ConfigError
from adrl.outputs import require_folder
from adrl.reproduction.experiments import chosen, preset
from adrl.reproduction.reproduce import reproduce
from adrl.reproduction.tables import PAGE_FILE, write_report

RESULTS_FOLDER = "results"


@dataclass(frozen=True, kw_only=True)
class ReproduceOptions:
    """One of --quick and --full."""

    quick: bool = False
    """2 seeds and short runs, some minutes on 2 cores: shows that everything works, proves nothing."""
    full: bool = False
    """10 seeds of every method in every place, up to 5 hours on 2 cores."""
    places: str = ""
    """clutter, hall, complex, complex-jackal and gazebo, names with commas between; all of them when left out, gazebo
    where Gazebo is set up. The others stay as they are in the results."""
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
        "Run the paper's section IV again: every method with every seed in every place, its figures and Table I, and "
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
        place: replace(config, workers=options.workers, ray=options.ray)
        for place, config in preset(name).items()
    }
    places = chosen(options.places, comparisons)
    for place in () if options.places else comparisons.keys() - places.keys():
        console().print(f"{place} is left out: Gazebo is not set up; scripts/gazebo-chroot does it")
    failed: dict[str, Path] = {}
    if not options.tables_only:
        with job_bar("reproducing") as show:
            failed = reproduce(comparisons, out, results, name=name, only=places, on_change=show)
    for job, log in failed.items():
        console().print(f"failed: {job}, see {log}", style="red")
    write_report(results)
    print(results / PAGE_FILE)
    return 1 if failed else 0
