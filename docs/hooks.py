"""What the site needs beyond its plugins: folders in the navigation, sections of README.md, files, equations as MathML.

MathML is drawn by the browser itself: no script, nothing fetched from elsewhere, but the font comes with the site.
In an equation `\\printed` parts the corrected form from the paper's, `\\\\` begins a line, `\\tag{9}` is its number.
"""

import html
import posixpath
import re
import shutil
import textwrap
from importlib import resources
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

SECTION = re.compile(r"^\[(.+?)\]\((?:\.\./)+README\.md(?:#[\w-]*)?\)$", re.MULTILINE)
FILE = re.compile(r"^( *)\[[^\]]+\]\((?:\.\./)+(ros2/[\w./-]+)\)$", re.MULTILINE)
MATH = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.+?)\\[)\]]</\1>', re.DOTALL)


def on_config(config: Any) -> None:
    """Put the pages of a folder, and those of its folders, where the navigation says `folder/*`, but those it names."""
    named = set(_pages(config.nav))
    config.nav = [entry for given in config.nav for entry in _expanded(given, Path(config.docs_dir), named)]


def on_page_markdown(markdown: str, page: Any, config: Any, **_: Any) -> str:
    """Put a section of README.md, or a file of ros2/, in the place of a line that only links to it, which a repository
    page shows."""
    root = Path(config.config_file_path).parent
    markdown = SECTION.sub(lambda match: _section(root / "README.md", match[1], page.file.src_uri), markdown)
    return FILE.sub(lambda match: _file(root / match[2], match[1]), markdown)


def on_page_content(content: str, **_: Any) -> str:
    """LaTeX to MathML."""
    return MATH.sub(_mathml, content)


def on_post_build(config: Any) -> None:
    """Lay the font for equations beside the style that names it."""
    font = resources.files("ziamath") / "fonts" / "STIXTwoMath-Regular.ttf"
    with resources.as_file(font) as path:
        shutil.copyfile(path, Path(config.site_dir) / "STIXTwoMath-Regular.ttf")


def _pages(entry: Any) -> list[str]:
    if isinstance(entry, str):
        return [entry]
    return [page for part in (entry.values() if isinstance(entry, dict) else entry) for page in _pages(part)]


def _expanded(entry: Any, docs: Path, named: set[str]) -> list[Any]:
    if isinstance(entry, dict):
        return [
            {
                title: content
                if isinstance(content, str)
                else [part for given in content for part in _expanded(given, docs, named)]
            }
            for title, content in entry.items()
        ]
    if not entry.endswith("/*"):
        return [entry]
    paths = [*docs.glob(entry + ".md"), *docs.glob(entry + "/README.md")]
    found = sorted(path.relative_to(docs).as_posix() for path in paths)
    return [page for page in found if page not in named]


def _section(readme: Path, heading: str, page: str) -> str:
    """The text below a heading, its links as they are from the page. Raises PluginError."""
    parts = re.split(r"^#+ (.+)\n", readme.read_text(encoding="utf-8"), flags=re.MULTILINE)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    if heading not in sections:
        raise PluginError(f"{page}: README.md has no heading {heading!r}; it has {', '.join(sections)}")
    up = posixpath.relpath(".", posixpath.dirname(page))
    return sections[heading].strip().replace("](docs/", f"]({up}/" if up != "." else "](")


def _file(path: Path, indent: str) -> str:
    """A file as a block, titled with its name."""
    language = {".py": "python"}.get(path.suffix, path.suffix[1:])
    text = path.read_text(encoding="utf-8")
    return textwrap.indent(f'```{language} title="{path.name}"\n{text}```', indent)


def _mathml(match: re.Match[str]) -> str:
    latex = html.unescape(match[2])
    if match[1] == "span":
        return convert(latex)
    latex, _, number = latex.strip().partition("\\tag{")
    forms = [_lines(form) for form in latex.split("\\printed")]
    if len(forms) == 2:
        forms[1] = f"<span>printed</span>{forms[1]}"
    rows = "".join(f"<div>{form}</div>" for form in forms)
    label = f"<span>({number.rstrip('}')})</span>" if number else ""
    return f'<div class="equation"><div>{rows}</div>{label}</div>'


def _lines(form: str) -> str:
    lines = (convert(line, display="block") for line in form.split("\\\\"))
    return f"<div>{''.join(f'<div>{line}</div>' for line in lines)}</div>"
