"""docs/tables.py: what stands in a page is what stands in its file."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
BLOCK = "before\n\n<!-- table: compare compare/complex.json -->\n<!-- end of table -->\n\nafter\n"


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    spec = importlib.util.spec_from_file_location("tables", ROOT / "docs" / "tables.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_table_is_that_of_its_file_and_the_rest_of_the_page_stays(tables: ModuleType) -> None:
    page = tables.rewritten(BLOCK)
    assert page.startswith("before\n\n<!-- table: compare compare/complex.json -->\n")
    assert page.endswith("\n<!-- end of table -->\n\nafter\n")
    assert "| ADRL | `map` | 10 | 99.6 [99.3, 99.9] | 98.4 |" in page
    assert tables.rewritten(page) == page


def test_a_number_that_is_not_in_its_file_is_found(tables: ModuleType) -> None:
    page = tables.rewritten(BLOCK)
    assert tables.rewritten(page.replace("99.6", "99.9")) == page


def test_an_unknown_form_and_an_absent_file_are_told(tables: ModuleType) -> None:
    with pytest.raises(KeyError, match="guess"):
        tables.rewritten(BLOCK.replace("table: compare", "table: guess"))
    with pytest.raises(FileNotFoundError):
        tables.rewritten(BLOCK.replace("complex", "absent"))


def test_the_pages_tell_what_their_files_say(tables: ModuleType) -> None:
    for path in tables.pages():
        text = path.read_text(encoding="utf-8")
        assert tables.rewritten(text) == text, f"{path}: run python docs/tables.py"
