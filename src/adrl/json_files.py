"""Reading JSON that somebody gives us: small, shallow, each key once, numbers finite, of the types it should be."""

import dataclasses
import json
import math
import os
from pathlib import Path
from typing import Any, Never, TypeVar

import msgspec

from adrl.errors import FileError, brief
from adrl.files import read_text

MAX_BYTES = 2**24
MAX_DEPTH = 32
MAX_DIGITS = 308
"""Of an integer: what a float holds. The state of a random generator has 39."""

T = TypeVar("T")


def read_json(path: str | os.PathLike[str], kind: type[T]) -> T:
    """The content of an ordinary JSON file, as parse_json gives it. Raises FileError."""
    return parse_json(read_text(path, MAX_BYTES), kind)


def parse_json(text: str, kind: type[T]) -> T:
    """The content of a JSON text, as checked gives it. Raises FileError."""
    try:
        content = json.loads(
            text, object_pairs_hook=_object, parse_int=_integer, parse_float=_finite, parse_constant=_finite
        )
    except RecursionError:
        raise FileError(f"is nested more than {MAX_DEPTH} deep") from None
    except ValueError as error:
        raise FileError(f"is not valid JSON: {error}") from None
    _require_shallow_text(content, 0)
    return checked(content, kind)


def checked(content: Any, kind: type[T]) -> T:
    """What JSON gave, as a kind that msgspec knows: a dataclass, a TypedDict, a list of them ...

    Keys that it does not know are left out; a dataclass with a field `extra` has them there. Raises FileError naming
    the place.
    """
    if dataclasses.is_dataclass(kind) and isinstance(content, dict):
        known = {field.name for field in dataclasses.fields(kind)}
        if "extra" in known:
            known.remove("extra")
            extra = {key: value for key, value in content.items() if key not in known}
            content = {key: content[key] for key in known & content.keys()} | {"extra": extra}
    try:
        return msgspec.convert(content, kind, dec_hook=_path)
    except msgspec.ValidationError as error:
        raise FileError(_told(str(error))) from None


def _path(kind: type, value: Any) -> Path:
    """What msgspec does not make by itself."""
    if kind is not Path or not isinstance(value, str):
        raise TypeError(f"expected {'a text' if kind is Path else kind.__name__}, got {type(value).__name__}")
    return Path(value)


def _told(error: str) -> str:
    """What msgspec says, for a user: a place within the file, without its head for the whole."""
    what, _, where = error.replace("`", "").partition(" - at ")
    place = where.removeprefix("$").lstrip(".")
    at = f" at {place}" if place else ""
    lacking = what.removeprefix("Object missing required field ")
    if lacking != what:
        return f"lacks {lacking}{at}"
    return f"is of another form{at}: {what[:1].lower() + what[1:]}"


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in content if keys.count(key) > 1)
        raise FileError(f"has {brief(twice)!r} twice; leave one")
    return content


def _integer(digits: str) -> int:
    if len(digits) > MAX_DIGITS:
        _refuse_number(digits)
    return int(digits)


def _finite(digits: str) -> float:
    number = float(digits)
    if not math.isfinite(number):
        _refuse_number(digits)
    return number


def _refuse_number(digits: str) -> Never:
    shown = digits if len(digits) <= 40 else f"of {len(digits)} digits"
    raise FileError(f"holds the number {shown}, which is not finite or too large")


def _require_shallow_text(content: Any, depth: int) -> None:
    """Nested no deeper than any reader needs, and no text that no file can hold. Raises FileError."""
    if isinstance(content, str):
        if not content.isascii() and any("\ud800" <= letter <= "\udfff" for letter in content):
            raise FileError("holds a text that is no Unicode")
    elif isinstance(content, (dict, list)):
        if depth == MAX_DEPTH:
            raise FileError(f"is nested more than {MAX_DEPTH} deep")
        if isinstance(content, dict):
            for key, value in content.items():
                _require_shallow_text(key, depth)
                _require_shallow_text(value, depth + 1)
        else:
            for value in content:
                _require_shallow_text(value, depth + 1)
