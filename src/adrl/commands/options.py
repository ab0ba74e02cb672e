"""Parsing and showing, as all commands do it."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import tyro

from adrl import files
from adrl.commands.progress import console
from adrl.errors import ConfigError, UnknownName

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

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


def given(options: "DataclassInstance") -> dict[str, Any]:
    """The options that are not as they are when left out, in their order: name -> value."""
    found = {}
    for option in fields(options):
        default = option.default if option.default_factory is MISSING else option.default_factory()
        value = getattr(options, option.name)
        if value != default:
            found[option.name] = value
    return found


def as_words(options: "DataclassInstance", names: Collection[str]) -> list[str]:
    """Those of the named options that are given, as they are typed."""
    words: list[str] = []
    for name, value in given(options).items():
        if name in names:
            values = value if isinstance(value, tuple) else (value,)
            words += [_flag(name)] if value is True else [_flag(name), *map(str, values)]
    return words


def refuse(options: "DataclassInstance", names: Collection[str], why: str) -> None:
    """These options would do nothing. why: goes on from the option. Raises ConfigError for the first that is given."""
    for name in given(options):
        if name in names:
            raise ConfigError(f"{_flag(name)} {why}")


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


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
    return _told(place.load())


def load_places(place: "Place") -> "tuple[Scenario, ...]":
    """The same of several scenarios."""
    return tuple(map(_told, place.load_all()))


def _told(scenario: "Scenario") -> "Scenario":
    for note in getattr(scenario, "notes", ()):
        console().print(f"{scenario.name}: {note}", markup=False, highlight=False, soft_wrap=True)
    return scenario


def tell_guidance(place: "Place", guidance: str | None) -> None:
    """A line where guidance was left out and is not goal: what drives the policy is not to be a surprise."""
    if guidance is None and place.default_guidance != "goal":
        console().print(
            f"guidance {place.default_guidance}: the policy is shown the way on the map; for a robot that has no "
            "map give --guidance replan"
        )


def write_document(path: Path | None, document: Mapping[str, Any]) -> None:
    """What option --json asks for: the file, or standard output for -, or nothing."""
    if path is None:
        return
    if str(path) == "-":
        print(files.to_json(document))
    else:
        files.write_json(path, document)
