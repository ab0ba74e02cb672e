"""Reading YAML that somebody gives us: safe, small, shallow, and each key once."""

import os
from collections import Counter
from typing import Any

import yaml

from adrl.errors import FileError, brief
from adrl.files import read_text

MAX_BYTES = 2**20
MAX_DEPTH = 32
MAX_NODES = 20_000
"""Values in a file; an alias counts as all that it stands for."""


class Twice(tuple[Any, ...]):
    """The values of a key that a file has more than once, where they differ."""


def read_yaml(path: str | os.PathLike[str], *, keep_all: bool = False) -> Any:
    """The content of an ordinary YAML file. Raises FileError.

    keep_all: a key may be there more than once, as ROS lets it: once where its values are the same, else as Twice.
    """
    text = read_text(path, MAX_BYTES)
    try:
        return yaml.load(text, Loader=_KeepingLoader if keep_all else _Loader)
    except yaml.MarkedYAMLError as error:
        line = f" in line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise FileError(f"is not valid YAML: {error.problem}{line}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise FileError(f"is not valid YAML: {brief(error)}") from None


class _Loader(yaml.SafeLoader):
    """The safe loader with limits. As for the parsers of map_server, a tab separates, but does not indent."""

    keep_all = False

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0
        self._nodes = 0
        self._size: dict[yaml.Node, int] = {}
        """Values of each finished node."""

    def scan_to_next_token(self) -> None:
        super().scan_to_next_token()
        while self.peek() == "\t":
            self.allow_simple_key &= bool(self.flow_level)
            self.forward()
            super().scan_to_next_token()

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        before, is_alias = self._nodes, self.check_event(yaml.AliasEvent)
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise FileError(f"is nested more than {MAX_DEPTH} deep")
        node = super().compose_node(parent, index)
        self._depth -= 1
        if node is None:
            return None
        self._nodes += self._size.get(node, MAX_NODES) if is_alias else 1  # an unfinished one holds itself
        if self._nodes > MAX_NODES:
            raise FileError(f"holds more than {MAX_NODES} values, aliases written out")
        if not is_alias:
            self._size[node] = self._nodes - before
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        keys = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        for name in (name for name, count in keys.items() if count > 1):
            if not self.keep_all:
                raise FileError(f"has {name!r} twice; leave one")
            pairs = [pair for pair in node.value if pair[0].value == name]
            values = yaml.SequenceNode(TWICE, [value for _, value in pairs])
            node.value = [pair for pair in node.value if pair not in pairs] + [(pairs[0][0], values)]
        return node


class _KeepingLoader(_Loader):
    keep_all = True


TWICE = "\0twice"
"""Marks the values of a key; no file can have such a tag."""


def _twice(loader: _Loader, node: yaml.SequenceNode) -> Any:
    values = Twice(loader.construct_sequence(node, deep=True))
    return values[0] if all(value == values[0] for value in values) else values


_Loader.add_constructor(TWICE, _twice)
