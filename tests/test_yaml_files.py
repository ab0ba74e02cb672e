"""YAML from others: what is read, and what is refused before it fills memory or time."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.errors import FileError
from adrl.files import read_bytes, read_text
from adrl.yaml_files import MAX_DEPTH, MAX_NODES, Twice, read_yaml

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text("ab: -#'\"{}[],&*!", max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text("abc", min_size=1), inner, max_size=3)
    ),
    max_leaves=10,
)


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "file.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@given(value=VALUES)
def test_what_was_written_comes_back(tmp_path_factory: pytest.TempPathFactory, value: object) -> None:
    import yaml

    assert read_yaml(written(tmp_path_factory.mktemp("yaml"), yaml.safe_dump(value))) == value


@pytest.mark.parametrize(
    "text",
    [
        "a: 1\nb: [2, 3]\n",
        "a:\t1\nb:\t[2,\t3\t]\t# tabs\n\t\n",
        "a: 1\r\nb: [2, 3]\r\n",
        "\ufeffa: 1\nb: [2, 3]\n",
        "a: &one 1\nc: &more {a: *one, b: [2, 3]}\n<<: *more\n",
    ],
)
def test_tabs_line_ends_and_byte_order_marks_change_nothing(tmp_path: Path, text: str) -> None:
    content = read_yaml(written(tmp_path, text))
    assert (content["a"], content["b"]) == (1, [2, 3])


def test_a_tab_does_not_indent(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"not valid YAML.*line 2"):
        read_yaml(written(tmp_path, "a: 1\n\tb: 2\n"))


def test_keys_that_are_there_twice_are_kept_where_that_is_asked_for(tmp_path: Path) -> None:
    text = "a: 1\nb: {c: [2], d: 3, c: [2]}\na: 4\na: {e: 5}\n2: x\n2: y\nf: 6\n"
    path = written(tmp_path, text)
    content = read_yaml(path, keep_all=True)
    assert content == {"a": (1, 4, {"e": 5}), "b": {"c": [2], "d": 3}, 2: ("x", "y"), "f": 6}
    assert isinstance(content["a"], Twice)
    with pytest.raises(FileError, match=r"has '[ac]' twice; leave one"):
        read_yaml(path)


def bomb(levels: int) -> str:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (bomb(9), f"more than {MAX_NODES} values"),
        ("a: &a [*a]", f"more than {MAX_NODES} values"),
        ("[" + "1," * MAX_NODES + "]", f"more than {MAX_NODES} values"),
        ("a: " + "[" * 3000 + "]" * 3000, f"more than {MAX_DEPTH} deep"),
        ("[" * 100_000, f"more than {MAX_DEPTH} deep"),
        ("a: *b", "undefined alias"),
        ("a: 1\nb: 2\na: 3\n", "'a' twice"),
        ("a: " + "1" * 5000, "not valid YAML"),
        ("a: 2020-13-45", "not valid YAML"),
        ("a: b: c", "in line 1"),
        ("a: [", "not valid YAML"),
        ("? [1]\n: 2", "not valid YAML"),
        ("!!python/object/apply:os.getcwd []", "not valid YAML"),
        ("a: \x00", "not valid YAML"),
        (b"a: \xff", "no text in UTF-8"),
        ("a: " + "x" * 2**20, "larger than 1 MiB"),
    ],
)
def test_what_is_refused_is_refused_at_once_and_in_one_line(
    tmp_path: Path, text: str | bytes, says: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(FileError) as caught:
        read_yaml(path)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_aliases_within_the_limits_are_read(tmp_path: Path) -> None:
    assert len(read_yaml(written(tmp_path, bomb(4)))["a3"]) == 9


def test_only_ordinary_files_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path):
        with pytest.raises(FileError, match="no ordinary file"):
            read_bytes(path, 10)
    with pytest.raises(FileError, match="does not exist"):
        read_bytes(tmp_path / "none", 10)
    with pytest.raises(FileError, match="cannot be read"):
        read_bytes("a\0b", 10)


@given(content=st.binary(max_size=40), most=st.integers(0, 40))
def test_a_file_is_read_whole_or_not_at_all(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, most: int
) -> None:
    path = written(tmp_path_factory.mktemp("bytes"), content)
    if len(content) > most:
        with pytest.raises(FileError, match="larger"):
            read_bytes(path, most)
    else:
        assert read_bytes(path, most) == content


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    assert read_text(written(tmp_path, b"\xef\xbb\xbfa"), 10) == "a"
