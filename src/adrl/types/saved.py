"""Options as files of before have them."""

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, ClassVar, get_origin, get_type_hints

from adrl.errors import CheckpointError


def without_constants(kind: type, saved: Mapping[str, Any]) -> dict[str, Any]:
    """What a file says of the options of a dataclass, and of the dataclasses in it.

    Options that are constants now are left out: files of before name them. Raises CheckpointError where one had another
    value.
    """
    kept = dict(saved)
    for name, hint in get_type_hints(kind).items():
        value = kept.get(name)
        if is_dataclass(hint) and isinstance(hint, type) and isinstance(value, Mapping):
            kept[name] = without_constants(hint, value)
        elif get_origin(hint) is ClassVar and name in kept:
            constant = getattr(kind, name)
            if kept.pop(name) != constant:
                raise CheckpointError(
                    f"{name} of {kind.__name__} was {value!r} and is always {constant!r} now; train anew, or use the "
                    "version of before"
                )
    return kept


def with_defaults(kind: type, saved: Mapping[str, Any]) -> dict[str, Any]:
    """What a file says of the options of a dataclass, and of the dataclasses in it; options that came after the file
    was written have their defaults."""
    kept = dict(saved)
    for option in fields(kind):
        default = option.default if option.default_factory is MISSING else option.default_factory()
        nested = is_dataclass(default) and not isinstance(default, type)
        value = kept.get(option.name, {} if nested else default)
        if nested and isinstance(value, Mapping):
            kept[option.name] = with_defaults(type(default), value)
        elif value is not MISSING:
            kept[option.name] = value
    return kept
