"""adrl compare."""

from collections.abc import Sequence

from adrl.commands.options import tell_guidance
from adrl.commands.progress import console, job_bar
from adrl.commands.run_options import parse_run
from adrl.comparison.compare import compare
from adrl.comparison.config import CompareConfig
from adrl.comparison.results import rich_table
from adrl.outputs import require_folder

COMMON = (
    *("methods", "seeds", "scenario", "map", "world", "robot", "guidance"),
    *("steps", "max_seconds", "workers", "out"),
)
"""What help shows first."""


def main(arguments: Sequence[str]) -> int:
    """Compare, print the table, and say which jobs failed."""
    config = parse_run(
        CompareConfig,
        arguments,
        "compare",
        "Train every method with every seed, each process on a core of its own, and evaluate all final policies on the "
        "same tasks, beside A*+DWA. The same command again goes on where it was stopped.",
        COMMON,
    )
    require_folder("--out", config.out)
    tell_guidance(config, config.guidance)
    with job_bar("comparing") as show:
        result = compare(config, show)
    console().print(rich_table(result.rows, config.title()))
    for name, log in result.failed.items():
        console().print(f"failed: {name}, see {log}", style="red")
    print(config.out)
    return 1 if result.failed else 0
