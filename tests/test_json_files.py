"""JSON from others: what is read, and what is refused before it fills memory or time, each with its place."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypedDict

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta

from adrl.errors import FileError
from adrl.json_files import MAX_BYTES, MAX_DEPTH, checked, parse_json, read_json

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)
OBJECTS = st.dictionaries(st.text(), VALUES, max_size=4)


@dataclass(frozen=True, kw_only=True)
class Net:
    size: int
    widths: tuple[Annotated[int, Meta(ge=1)], ...] = ()
    share: float = 0.0
    folder: Path | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)


class Inner(TypedDict):
    seed: int | None


class Outer(TypedDict, total=False):
    rows: list[Inner]


@given(content=OBJECTS)
def test_what_was_written_comes_back(content: dict[str, Any]) -> None:
    for text in (json.dumps(content), json.dumps(content, ensure_ascii=False, indent=1)):
        assert parse_json(text, dict[str, Any]) == content


@given(others=OBJECTS)
def test_keys_that_a_dataclass_does_not_know_are_its_extra(others: dict[str, Any]) -> None:
    own = {"size": 3, "widths": [4, 5], "share": 1, "folder": "a/b"}
    net = parse_json(json.dumps(others | own), Net)
    rest = {key: value for key, value in others.items() if key not in own}
    assert net == Net(size=3, widths=(4, 5), share=1.0, folder=Path("a/b"), extra=rest)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is not valid JSON"),
        ('{"a": 1', "is not valid JSON"),
        ("{} {}", "is not valid JSON"),
        ("[" * 100_000, f"is nested more than {MAX_DEPTH} deep"),
        ('{"a":' * 100_000, f"is nested more than {MAX_DEPTH} deep"),
        ("[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1), f"is nested more than {MAX_DEPTH} deep"),
        ("1" * 5000, "holds the number of 5000 digits"),
        ("[1e400]", "holds the number 1e400"),
        ("[-1.0e999]", "holds the number -1.0e999"),
        ("[NaN]", "holds the number NaN"),
        ("[-Infinity]", "holds the number -Infinity"),
        ('{"a": 1, "b": 2, "a": 3}', "has 'a' twice"),
        (r'{"a": "\ud800"}', "holds a text that is no Unicode"),
        (r'{"\udc00": 1}', "holds a text that is no Unicode"),
    ],
)
def test_what_no_reader_wants_is_refused(text: str, says: str) -> None:
    with pytest.raises(FileError, match=f"^{says}"):
        parse_json(text, dict[str, Any])


def test_nesting_up_to_the_limit_and_the_state_of_a_generator_are_read() -> None:
    assert parse_json("[" * MAX_DEPTH + "]" * MAX_DEPTH, list[Any])
    assert parse_json(f"[{2**128}, -0.0e999]", list[float]) == [2.0**128, 0.0]


@pytest.mark.parametrize(
    ("content", "kind", "says"),
    [
        ({}, Net, "lacks size"),
        ([1], Net, "is of another form: expected object, got array"),
        ({"size": "3"}, Net, "is of another form at size: expected int, got str"),
        ({"size": True}, Net, "is of another form at size: expected int, got bool"),
        ({"size": 3.5}, Net, "is of another form at size: expected int, got float"),
        ({"size": 3, "widths": [1, 0]}, Net, r"is of another form at widths\[1\]: expected int >= 1"),
        ({"size": 3, "share": [0.5]}, Net, "is of another form at share: expected float, got array"),
        ({"size": 3, "folder": 4}, Net, "is of another form at folder: expected a text, got int"),
        ({"rows": [{"seed": 1}, {}]}, Outer, r"lacks seed at rows\[1\]"),
        ({"rows": {}}, Outer, "is of another form at rows: expected array, got object"),
    ],
)
def test_another_form_is_told_with_its_place(content: object, kind: type, says: str) -> None:
    with pytest.raises(FileError, match=f"^{says}"):
        checked(content, kind)


def test_only_ordinary_small_text_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "file.json"
    path.write_bytes(b"\xef\xbb\xbf[1]")
    assert read_json(path, list[int]) == [1]
    os.mkfifo(tmp_path / "pipe")
    large, binary = tmp_path / "large", tmp_path / "binary"
    large.write_bytes(b" " * (MAX_BYTES + 1))
    binary.write_bytes(b"\xff\xfe\x00rubbish")
    places = {tmp_path / "gone": "does not exist", tmp_path: "no ordinary file", large: "larger than 16 MiB"}
    places |= {tmp_path / "pipe": "no ordinary file", Path("/dev/zero"): "no ordinary file", binary: "UTF-8"}
    for place, says in places.items():
        with pytest.raises(FileError, match=says):
            read_json(place, list[int])
