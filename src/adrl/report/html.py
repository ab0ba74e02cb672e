"""report.html: one file that holds its data, its pictures and its program, and asks nothing of any network."""

import json
import os
import re
from importlib import resources
from pathlib import Path

from adrl import files
from adrl.report.document import document
from adrl.report.source import Source

SHARED = ("parts.js", "reasons.js", "scene.js", "strips.js", "curves.js")
"""Programs that adrl view draws with, too."""
SCRIPTS = (*SHARED, "data.js", "table.js", "episode.js", "replay.js", "charts.js", "main.js")
_SLOT = re.compile(r"<!-- slot: (\w+) -->")


def write_report(source: Source, out: str | os.PathLike[str]) -> None:
    """Write the page to out, at once. Raises CheckpointError on a bad log."""
    plotly = plotly_script()
    files.atomic_write_text(out, page(source, plotly))


def page(source: Source, plotly: str) -> str:
    """The whole page. The data are JSON in an element of their own, with nothing that could end it."""
    data = json.dumps(document(source), allow_nan=False, separators=(",", ":"))
    parts = {
        "title": _escape(f"{source.name} · ADRL report"),
        "style": asset("style.css"),
        "data": data.replace("<", "\\u003c"),
        "plotly": plotly,
        "program": "(() => {\n'use strict';\n" + "\n".join(map(asset, SCRIPTS)) + "\n})();",
    }
    return _SLOT.sub(lambda slot: parts[slot.group(1)], asset("page.html"))


def plotly_script() -> str:
    """Plotly's program, as the Python package ships it."""
    from plotly.offline import get_plotlyjs  # not at the top: it takes a while

    return get_plotlyjs()


def asset(name: str) -> str:
    """The text of one of the page's files."""
    path = Path(str(resources.files("adrl.report") / "page" / name))
    return path.read_text(encoding="utf-8")


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
