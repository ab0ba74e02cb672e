"""A URDF as a tree of links, and where they are on the robot. Needs the extra `urdf`: yourdfpy."""

import io
import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from adrl import files
from adrl.errors import ConfigError, FileError, MissingExtra, WorldError, brief
from adrl.types import Array
from adrl.worlds.sdf.document import element_of

MAX_BYTES = 16 * 2**20
BASES = ("base_link", "base_footprint")
"""Links that are the robot's frame, by REP 105; else it is the root."""


def parse(path: Path) -> Element:
    """The <robot>. Raises ConfigError."""
    try:
        root = element_of(files.read_bytes(path, MAX_BYTES))
    except FileError as error:
        raise ConfigError(f"{path} {error}; give a URDF") from None
    except expat.ExpatError as error:
        raise ConfigError(f"{path} is not well-formed XML: {error}; give a URDF") from None
    except (LookupError, ValueError, AssertionError):
        raise ConfigError(f"{path} is no XML that can be read; save it as UTF-8, and give a URDF") from None
    except WorldError as error:
        raise ConfigError(f"{path} {error}") from None
    if any(e.tag.startswith("xacro:") or "${" in "".join(e.attrib.values()) for e in root.iter()):
        raise ConfigError(f"{path} is a xacro file; run: xacro {path} > robot.urdf, and give robot.urdf")
    if root.tag != "robot":
        raise ConfigError(f"{path} is no URDF: it has <{brief(root.tag)}> instead of <robot>")
    return root


def listed(names: list[str]) -> str:
    """The first names of many."""
    return ", ".join(map(brief, names[:8])) + (", ..." if len(names) > 8 else "")


Step = tuple[str, str, str]
"""From a link to the one that it hangs on, by a joint, of a type."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """Links, and where they are on the robot while its joints are at 0."""

    base: str
    """The link that is the robot's frame."""
    shapes: Mapping[str, list[Any]]
    """Link -> its collisions, as yourdfpy has them."""
    parents: Mapping[str, Step]
    poses: Mapping[str, Array]
    """Link -> (4, 4) in the base."""

    @classmethod
    def of(cls, root: Element, path: Path, base: str | None = None) -> "Body":
        """base: the link that is the robot's frame; by its name when None. Raises ConfigError."""
        try:
            import yourdfpy
        except ModuleNotFoundError:
            raise MissingExtra.named("urdf", "reading a URDF") from None
        try:
            with _quiet():
                urdf: Any = yourdfpy.URDF.load(io.BytesIO(ElementTree.tostring(root)), load_meshes=False)
                links = list(urdf.link_map)
                named = [base, *BASES] if base is not None else BASES
                base = str(next((name for name in named if name in links), urdf.base_link))
                poses = {name: np.asarray(urdf.get_transform(name, base)) for name in links}
            shapes = {name: list(urdf.link_map[name].collisions) for name in links}
            parents = {j.child: (j.parent, j.name, j.type) for j in urdf.robot.joints}
        except Exception as error:  # what a URDF that is none makes yourdfpy raise is not documented
            what = brief(f"{type(error).__name__}: {error}")
            raise ConfigError(f"{path} is no URDF that can be used ({what}); check it: check_urdf") from None
        wrong = _tree_fault(list(shapes), [j.child for j in urdf.robot.joints], parents)
        if wrong is not None:
            raise ConfigError(f"{path} is no tree of links: {wrong}; check it: check_urdf")
        if not all(np.isfinite(pose).all() and np.abs(pose).max() < 1e6 for pose in poses.values()):
            raise ConfigError(f"{path} has a joint whose <origin> is no place; give finite numbers")
        return cls(base=base, shapes=shapes, parents=parents, poses=poses)

    def movable(self, link: str) -> str | None:
        """A joint between a link and the base that is not fixed; None where the link is at rest on the robot."""
        ways = [_way(link, self.parents), _way(self.base, self.parents)]
        apart = [step for way, other in (ways, ways[::-1]) for step in way if step not in other]
        return next((name for _, name, kind in apart if kind != "fixed"), None)


def _way(link: str, parents: Mapping[str, Step]) -> list[Step]:
    """The steps from a link up to the root; in a loop one more than there are links."""
    way: list[Step] = []
    while link in parents and len(way) <= len(parents):
        way.append(parents[link])
        link = parents[link][0]
    return way


def _tree_fault(links: list[str], children: list[str], parents: Mapping[str, Step]) -> str | None:
    """Why links and joints are no tree; None where they are one."""
    twice = next((child for child in children if children.count(child) > 1), None)
    if twice is not None:
        return f"{brief(twice)} hangs on several joints"
    loop = next((link for link in links if len(_way(link, parents)) > len(parents)), None)
    if loop is not None:
        return f"{brief(loop)} hangs on itself"
    roots = [link for link in links if link not in parents]
    return f"{listed(roots)} hang on no joint, and one has to" if len(roots) > 1 else None


@contextmanager
def _quiet() -> Iterator[None]:
    """Without yourdfpy's log: what matters of it is an error."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)
