"""CONTRIBUTING.md says of the code what is so."""

import importlib
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_its_layers_are_those_that_are_checked() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    checked = next(contract["layers"] for contract in contracts if contract["id"] == "layers")
    shown = re.search(r"^```\n((?:cli|adrl).+?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert shown
    assert shown[1].splitlines() == [line.replace("adrl.", "").replace(" : ", ", ") for line in checked]


def test_each_table_is_in_the_file_that_is_named() -> None:
    named = re.findall(r"`([A-Z_]+)` in `(adrl/[a-z_/]+)\.py`", PAGE)
    assert len(named) >= 6
    for table, file in named:
        module = importlib.import_module(file.replace("/", ".").removesuffix(".__init__"))
        assert hasattr(module, table), (table, file)
