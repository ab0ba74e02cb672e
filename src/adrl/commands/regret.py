"""adrl regret."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from adrl import extras
from adrl.commands.options import parse
from adrl.commands.progress import console, job_bar
from adrl.outputs import require_folder
from adrl.regret.page import PAGE_FILE, few_seeds, write_page
from adrl.regret.regret import ENOUGH_SEEDS, QUICK_SEEDS, preset, regret


@dataclass(frozen=True, kw_only=True)
class RegretOptions:
    """Which part of the protocol, and where."""

    cells: str = ""
    """Names with commas between; all of them when left out. --list shows them."""
    methods: str = ""
    """Names with commas between, the first of which the others are paired with; adrl and its rivals when left out."""
    seeds: int | None = None
    """Training seeds of each method in each cell, 10 when left out and 2 with --quick; fewer than 10 make no claim."""
    quick: bool = False
    """4,096 steps and 20 tasks in every cell: shows that everything works, proves nothing."""
    list: bool = False
    """Print the cells and run nothing."""
    tables_only: bool = False
    """Run nothing: tables and figure of the cells that are complete."""
    out: Path | None = None
    """Folder of the results; runs/regret when left out, runs/regret-quick with --quick. The same command again goes on
    where it was stopped; cells, methods and seeds may be added."""
    workers: int = 0
    """Processes, each on a core of its own; 0 takes one for every usable core."""
    ray: str | None = None
    """Address of a Ray cluster, HOST:PORT, that runs the jobs instead of processes here, one for each of its CPUs."""


def main(arguments: Sequence[str]) -> int:
    """Run what is missing, write tables and figure, and say which jobs failed."""
    options = parse(
        RegretOptions,
        arguments,
        "regret",
        "Compare methods by their regret to the best one, over cells that differ in expert, reward, place and robot: "
        "each method with one configuration, each seed on the same demonstrations and tasks.",
    )
    out = options.out or Path("runs") / ("regret-quick" if options.quick else "regret")
    seeds = options.seeds if options.seeds is not None else QUICK_SEEDS if options.quick else ENOUGH_SEEDS
    comparisons = {
        name: replace(config, workers=options.workers, ray=options.ray)
        for name, config in preset(
            out, cells=options.cells, methods=options.methods, seeds=seeds, quick=options.quick
        ).items()
    }
    if options.list:
        for name, config in comparisons.items():
            print(f"{name}: {config.title()}")
        return 0
    extras.require("regret", "adrl regret")
    require_folder("--out", out)
    failed: dict[str, Path] = {}
    if not options.tables_only:
        with job_bar("comparing") as show:
            failed = regret(comparisons, show)
    write_page(comparisons, out)
    if warning := few_seeds(seeds):
        console().print(f"WARNING: {warning}", style="yellow")
    for job, log in failed.items():
        console().print(f"failed: {job}, see {log}", style="red")
    print(out / PAGE_FILE)
    return 1 if failed else 0
