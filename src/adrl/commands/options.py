"""Parsing and showing, as all commands do it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from adrl import files
from adrl.errors import UnknownName

if TYPE_CHECKING:
    from adrl.types import Scenario
    from adrl.worlds.place import Place

Options = TypeVar("Options")
Runner = Callable[[Sequence[str]], int]
"""Takes the arguments, returns the exit code."""


def parse(options: type[Options], arguments: Sequence[str], command: str, description: str) -> Options:
    """Options of a command from its arguments; exits with 2 and a message on bad ones."""
    return tyro.cli(
        options,
        args=list(arguments),
        prog=f"adrl {command}",
        description=description,
    )


def subcommand(
    command: str, noun: str, kinds: Mapping[str, tuple[str, Runner]], arguments: Sequence[str], note: str = ""
) -> int:
    """Run the kind of a command that the arguments begin with, or list the kinds: name -> what it does, and how.

    noun: what a kind is called in errors. Raises UnknownName with the nearest one.
    """
    if not arguments or arguments[0] in ("-h", "--help"):
        print(f"usage: adrl {command} WHAT [OPTIONS]\n")
        width = max(map(len, kinds)) + 1
        for name, (text, _) in kinds.items():
            print(f"  {name:<{width}} {text}")
        print(f"\nadrl {command} WHAT --help explains the options.{note}")
        return 0 if arguments else 2
    what, rest = arguments[0], arguments[1:]
    if what not in kinds:
        raise UnknownName(noun, what, kinds)
    return kinds[what][1](rest)


def load_place(place: "Place") -> "Scenario":
    """The scenario, map or worlds; what is to be known of how it was read goes to the terminal, a line each."""
    scenario = place.load()
    for note in getattr(scenario, "notes", ()):
        console().print(f"{scenario.name}: {note}", markup=False, highlight=False, soft_wrap=True)
    return scenario


def write_document(path: Path | None, document: Mapping[str, Any]) -> None:
    """What option --json asks for: the file, or standard output for -, or nothing."""
    if path is None:
        return
    if str(path) == "-":
        print(files.to_json(document))
    else:
        files.write_json(path, document)


def console() -> Console:
    """Where tables and bars go: standard error keeps standard output clean for data."""
    return Console(stderr=True)


@contextmanager
def progress_bar(description: str) -> Iterator[tuple[Progress, Any]]:
    """A live bar from 0 to 1 with the time left."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=console()) as bar:
        yield bar, bar.add_task(description, total=1.0, note="")


@contextmanager
def counting_bar(description: str, things: str) -> Iterator[Callable[[int, int], None]]:
    """A live bar; the function to call with how many of the things have ended, of how many."""
    with progress_bar(description) as (bar, task):

        def show(ended: int, total: int) -> None:
            bar.update(task, completed=ended / total, note=f"{ended} of {total} {things}")

        yield show
