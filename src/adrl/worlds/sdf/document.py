"""SDF as XML, and the numbers in it: read with limits, as a world may come from anywhere."""

import codecs
import math
import os
import re
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

from adrl import files
from adrl.errors import FileError, WorldError

MAX_BYTES = 64 * 2**20
MAX_ELEMENTS = 2_000_000
"""Elements of one file; the largest of 700 public worlds has 130,000."""
MAX_DEPTH = 200
"""Elements within elements."""
MAX_NUMBER = 1e9
"""Metres, and whatever else: beyond, products of numbers lose the millimetre."""
MIN_SIZE_M = 1e-6

HEAD = re.compile(rb"<\?xml\s[^>]{0,200}\?>")
COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
INVALID_TOKEN = expat.errors.codes[expat.errors.XML_ERROR_INVALID_TOKEN]
KINDS = "give a Gazebo .world or .sdf file"


def parse(path: str | os.PathLike[str]) -> Element:
    """The root element. A DOCTYPE is refused: entities can be made to fill the memory. Raises WorldError."""
    try:
        content = files.read_bytes(path, MAX_BYTES)
    except FileError as error:
        raise WorldError(f"{error}; {KINDS}") from None
    try:
        return element_of(content)
    except expat.ExpatError as error:
        if _is_stage(content):
            raise WorldError(
                f"is a world of Stage, not of Gazebo; {KINDS}, or its image with --map"
            ) from None
        raise WorldError(f"is not well-formed XML: {error}; {KINDS}") from None
    except (LookupError, ValueError) as error:
        raise WorldError(f"has an encoding that cannot be read ({error}); save it as UTF-8") from None
    except AssertionError:
        raise WorldError(f"is not well-formed XML; {KINDS}") from None


def element_of(content: bytes) -> Element:
    """The root, or an error of expat. Lenient where Gazebo is: before the XML head, in comments, in encodings."""
    content = content.removeprefix(codecs.BOM_UTF8)
    head = HEAD.search(content)
    if head is not None and head.start() > 0:
        content = head[0] + content[: head.start()] + content[head.end() :]
    try:
        return _Limited().parse(content)
    except expat.ExpatError as error:
        if error.code != INVALID_TOKEN:
            raise
    # Comments with -- in them; their lines stay, for what is said of other lines.
    content = COMMENT.sub(lambda found: b"\n" * found[0].count(b"\n"), content)
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return _Limited(encoding="iso-8859-1").parse(content)
    return _Limited().parse(content)


def root_of(path: Path, tag: str) -> Element:
    """The first element of this tag in an <sdf> file. Raises WorldError."""
    root = parse(path)
    found = root.find(tag) if root.tag in ("sdf", "gazebo") else None
    if found is None:
        what = "is a URDF, not an SDF" if root.tag == "robot" else f"has no <{tag}>"
        raise WorldError(f"{what}; {KINDS}")
    return found


class _Limited:
    """An ElementTree builder behind expat that gives up on what no world is."""

    def __init__(self, encoding: str | None = None) -> None:
        self.builder = ElementTree.TreeBuilder()
        self.expat = expat.ParserCreate(encoding)
        self.expat.StartElementHandler = self._start
        self.expat.EndElementHandler = self._end
        self.expat.CharacterDataHandler = self.builder.data
        self.expat.StartDoctypeDeclHandler = self._refuse
        self._depth = self._count = 0

    def parse(self, content: bytes) -> Element:
        """The root."""
        self.expat.Parse(content, True)
        return self.builder.close()

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        self._count += 1
        if self._depth > MAX_DEPTH:
            raise WorldError(f"is nested more than {MAX_DEPTH} elements deep; leave some out")
        if self._count > MAX_ELEMENTS:
            raise WorldError(f"has more than {MAX_ELEMENTS} elements; leave some out")
        self.builder.start(tag, attributes)

    def _end(self, tag: str) -> None:
        self._depth -= 1
        self.builder.end(tag)

    @staticmethod
    def _refuse(*_: object) -> None:
        raise WorldError("has a DOCTYPE; remove it, nothing needs one")


def _is_stage(content: bytes) -> bool:
    """Whether a text that is no XML looks like a .world of Stage: `define name kind (`, `floorplan (`."""
    lines = [line.split(b"#")[0].strip() for line in content[:100_000].splitlines()]
    words = [line.replace(b"(", b" ( ").split() for line in lines if line]
    return any(w[0] in (b"define", b"floorplan", b"window", b"include", b"resolution") for w in words)


def numbers(
    owner: Element, tag: str, count: int, name: str, default: tuple[float, ...] | None = None
) -> tuple[float, ...]:
    """The numbers in the owner's child of this tag. Raises WorldError with the owner's name."""
    text = owner.findtext(tag)
    if text is None and default is not None:
        return default
    return words(text, count, f"{name}: <{tag}> of <{owner.tag}>")


def words(text: str | None, count: int, what: str) -> tuple[float, ...]:
    """So many numbers of a text. Raises WorldError that says what is not."""
    try:
        found = tuple(float(word) for word in (text or "").split())
    except ValueError:
        found = ()
    if len(found) != count or not all(math.isfinite(number) for number in found):
        raise WorldError(f"{what} is {_short(text)}; give {count} finite numbers")
    if max(map(abs, found)) > MAX_NUMBER:
        raise WorldError(f"{what} is {_short(text)}; give numbers up to {MAX_NUMBER:g}")
    return found


def sizes(
    owner: Element, tag: str, count: int, name: str, default: tuple[float, ...] | None = None
) -> tuple[float, ...]:
    """Such numbers that are lengths of a shape."""
    found = numbers(owner, tag, count, name, default)
    if min(found) < MIN_SIZE_M:
        raise WorldError(f"{name} has a shape of size {found}; give positive numbers from {MIN_SIZE_M:g} m")
    return found


def flag(owner: Element, tag: str, default: bool = False) -> bool:
    """The boolean in the owner's child of this tag."""
    text = owner.findtext(tag)
    return default if text is None else text.strip().lower() in ("true", "1")


def _short(text: str | None) -> str:
    shown = repr(" ".join((text or "").split()))
    return shown if len(shown) <= 60 else f"{shown[:56]}...'"
