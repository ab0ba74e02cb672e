"""Options of a training run as the command line shows them: the common ones first, the others in groups."""

import ast
import inspect
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import field, fields, is_dataclass, make_dataclass, replace
from typing import Annotated, Any, TypeVar, get_type_hints

import tyro

from adrl.commands.options import parse
from adrl.runs import RunConfig
from adrl.worlds.place import Place

Run = TypeVar("Run", bound=RunConfig)

PLACE = "Where to drive, beside the common options."
GROUPS = {
    "expert": (
        "Demonstrations, and what they are used for first.",
        (
            "expert",
            "teachers",
            "demonstration_steps",
            "demonstration_rounds",
            "dataset",
            "pretrain_updates",
            "critic_warmup_updates",
        ),
    ),
    "simulation": ("What trains, and in how many worlds.", ("env", "num_envs", "task_pool", "randomize")),
    "learning": (
        "How the policy learns.",
        (
            *("paper_literal", "fine_tune", "start_steps", "replay_capacity"),
            *("exploration_std", "failure_share", "mirror", "stop_within_m"),
        ),
    ),
    "records": (
        "What is written, and how often.",
        (
            *("log_interval_steps", "eval_interval_steps", "validation_episodes"),
            "checkpoint_interval_steps",
        ),
    ),
}
"""Name -> what is in it, and the options. Those in none of them are the command's own."""


def parse_run(
    options: type[Run], arguments: Sequence[str], command: str, description: str, common: Sequence[str]
) -> Run:
    """As options.parse; `common` are the options that help shows first, in this order."""
    base = options()
    hints, helps = _described(options, type(base.learner))
    values = {name: getattr(base if name in _names(base) else base.learner, name) for name in hints}
    nested = [name for name in hints if is_dataclass(hints[name])]
    place = [f.name for f in fields(Place)]
    groups = {"place": (PLACE, place)} | GROUPS
    grouped = {name for _, names in groups.values() for name in names}
    own = [name for name in hints if name not in {*common, *grouped, *nested}]
    if own:
        groups = {command: ("What is the command's own.", own)} | groups

    def part(name: str) -> tuple[str, Any, Any]:
        text = () if name in nested else (tyro.conf.arg(help=helps[name]),)
        hint: Any = Annotated[(hints[name], *text)] if text else hints[name]
        return name, hint, field(default_factory=lambda: values[name])

    def group(title: str, text: str, names: Iterable[str]) -> tuple[str, Any, Any]:
        kind = make_dataclass(title, [part(name) for name in names if name in hints and name not in common])
        marks = tyro.conf.OmitArgPrefixes, tyro.conf.arg(help=text)
        return title, Annotated[(kind, *marks)], field(default_factory=kind)

    parts = [part(name) for name in common]
    parts += [group(title, text, names) for title, (text, names) in groups.items()]
    view = make_dataclass("Options", [*parts, *map(part, nested)])
    parsed = parse(view, arguments, command, description)
    holders = [parsed, *(getattr(parsed, title) for title in groups)]
    given = {f.name: getattr(holder, f.name) for holder in holders for f in fields(holder)}
    of_learner = {name: given[name] for name in hints if name in _names(base.learner)}
    of_run = {name: given[name] for name in hints if name not in of_learner}
    return replace(base, **of_run, learner=replace(base.learner, **of_learner))


def _names(config: Any) -> set[str]:
    return {f.name for f in fields(config)}


def _described(*kinds: type) -> tuple[dict[str, Any], dict[str, str]]:
    """Types and explanations of the options, without the learner itself and what the command line does not set."""
    hints: dict[str, Any] = {}
    helps: dict[str, str] = {}
    for kind in kinds:
        types = get_type_hints(kind, include_extras=True)
        for name in (f.name for f in fields(kind)):
            if name != "learner" and tyro.conf.Suppress not in getattr(types[name], "__metadata__", ()):
                hints[name] = types[name]
        for owner in reversed(kind.__mro__):
            if is_dataclass(owner):
                helps |= _explained(owner)
    return hints, helps


def _explained(kind: type) -> dict[str, str]:
    """The text below each field of a class."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    found = {}
    for statement, below in zip(tree.body, tree.body[1:], strict=False):
        if isinstance(statement, ast.AnnAssign) and isinstance(below, ast.Expr):
            text = inspect.cleandoc(ast.literal_eval(below.value))
            found[ast.unparse(statement.target)] = re.sub(r"(?<!\n)\n(?!\n)", " ", text)
    return found
