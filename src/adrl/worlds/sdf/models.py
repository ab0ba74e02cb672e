"""The models of a world as a tree, with what <include> names put in its place."""

from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element

from adrl.errors import WorldError
from adrl.worlds.sdf.frames import Scope
from adrl.worlds.sdf.library import Library

MAX_NESTED = 32
MAX_MODELS = 50_000
"""Models that includes in includes may come to."""
NOT_SOLID = ("ground_plane", "sun")
"""Models that <include> may name without having them: they hold nothing a robot runs into."""


@dataclass
class Ignored:
    """Names and patterns of what is to be left out: model, outer::inner, model::link, model::link::collision."""

    patterns: tuple[str, ...]
    used: set[str] = field(default_factory=set)

    def __contains__(self, path: object) -> bool:
        hits = {pattern for pattern in self.patterns if fnmatchcase(str(path), pattern)}
        self.used |= hits
        return bool(hits)

    @property
    def unused(self) -> list[str]:
        """Those that nothing was called like."""
        return [pattern for pattern in self.patterns if pattern not in self.used]


@dataclass
class Builder:
    """Makes Scopes of elements."""

    library: Library
    ignored: Ignored
    count: int = 0

    def model(
        self, element: Element, folder: Path, parent: str, depth: int = 0, merged: bool = False
    ) -> Scope:
        """A model and all in it. Raises WorldError, which begins with the model's name."""
        name = element.get("name", "")
        path = f"{parent}::{name}" if parent else name
        self.count += 1
        if depth > MAX_NESTED:
            raise WorldError(f"model {path!r} is nested more than {MAX_NESTED} deep")
        if self.count > MAX_MODELS:
            raise WorldError(f"model {path!r} is one of more than {MAX_MODELS}; include less")
        scope = Scope(element, path, folder, merged)
        scope.add(self.nested(scope, depth))
        return scope

    def nested(self, scope: Scope, depth: int) -> list[Scope]:
        """The models in a model, included ones too."""
        found = []
        for child in scope.element:
            if child.tag == "model" and f"{scope.path}::{child.get('name', '')}" not in self.ignored:
                found.append(self.model(child, scope.folder, scope.path, depth + 1))
            elif child.tag == "include" and f"{scope.path}::{include_name(child)}" not in self.ignored:
                element, folder = self.included(child, scope.folder, scope.label)
                merged = child.get("merge") in ("true", "1")
                if element is not None and element.tag == "model":
                    found.append(self.model(element, folder, scope.path, depth + 1, merged))
        return found

    def included(self, include: Element, folder: Path, owner: str) -> tuple[Element | None, Path]:
        """The element that an <include> stands for, with the name, pose and static that it is given; its folder.

        None where it holds nothing solid.
        """
        uri = (include.findtext("uri") or "").strip()
        if not uri:
            raise WorldError(f"{owner} includes a model without <uri>; name it")
        if plain_name(uri) in NOT_SOLID:
            return None, folder
        try:
            source, place = self.library.model(uri, folder)
        except WorldError as error:
            raise WorldError(f"{owner} {error}") from None
        element = Element(source.tag, dict(source.attrib))
        replaced = {tag: found for tag in ("pose", "static") if (found := include.find(tag)) is not None}
        element.extend([*(child for child in source if child.tag not in replaced), *replaced.values()])
        element.set("name", (include.findtext("name") or "").strip() or source.get("name", ""))
        frame = (include.findtext("placement_frame") or "").strip()
        if frame:
            element.set("placement_frame", frame)
        return element, place


def plain_name(uri: str) -> str:
    """What an address calls the model, as folders are called: its last part that is no version."""
    parts = [part for part in unquote(uri).split("/") if part and not part.isdigit() and part != "tip"]
    return parts[-1].lower().replace(" ", "_") if parts else ""


def include_name(include: Element) -> str:
    """What an <include> is called as long as its model is not read."""
    return (include.findtext("name") or "").strip() or plain_name((include.findtext("uri") or "").strip())
