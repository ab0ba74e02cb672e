"""A URDF as a tree of links, and where they are on the robot. Needs the extra `urdf`: yourdfpy."""

import io
import logging
from collections import Counter
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
MAX_LINKS = 1000
"""And as many joints; the largest of public robots has some 200."""
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
        most = max(len(root.findall("link")), len(root.findall("joint")))
        if most > MAX_LINKS:
            raise ConfigError(f"{path} has {most} links or joints; give a URDF of up to {MAX_LINKS}")
        try:
            import yourdfpy
        except ModuleNotFoundError:
            raise MissingExtra.named("urdf", "reading a URDF") from None
        try:
            with _quiet():
                urdf: Any = yourdfpy.URDF.load(
                    io.BytesIO(ElementTree.tostring(root)), build_scene_graph=False, load_meshes=False
                )
            shapes = {name: list(link.collisions) for name, link in urdf.link_map.items()}
            joints = list(urdf.robot.joints)
            in_root = _placed(list(shapes), joints)
        except _NoTree as error:
            raise ConfigError(f"{path} is no tree of links: {error}; check it: check_urdf") from None
        except Exception as error:  # what a URDF that is none makes yourdfpy raise is not documented
            what = brief(f"{type(error).__name__}: {error}")
            raise ConfigError(f"{path} is no URDF that can be used ({what}); check it: check_urdf") from None
        if not all(np.isfinite(pose).all() and np.abs(pose).max() < 1e6 for pose in in_root.values()):
            raise ConfigError(f"{path} has a joint whose <origin> is no place; give finite numbers")
        named = [base, *BASES] if base is not None else BASES
        base = next((name for name in named if name in shapes), next(iter(in_root)))
        inverse = np.linalg.inv(in_root[base])
        return cls(
            base=base,
            shapes=shapes,
            parents={joint.child: (joint.parent, joint.name, joint.type) for joint in joints},
            poses={name: inverse @ pose for name, pose in in_root.items()},
        )

    def movable(self, link: str) -> str | None:
        """A joint between a link and the base that is not fixed; None where the link is at rest on the robot."""
        ways = [_way(link, self.parents), _way(self.base, self.parents)]
        apart = [step for way, other in (ways, ways[::-1]) for step in way if step not in other]
        return next((name for _, name, kind in apart if kind != "fixed"), None)


def _way(link: str, parents: Mapping[str, Step]) -> list[Step]:
    """The steps from a link up to the root."""
    way: list[Step] = []
    while link in parents:
        way.append(parents[link])
        link = parents[link][0]
    return way


class _NoTree(Exception):
    """Links and joints are no tree."""


def _placed(links: list[str], joints: list[Any]) -> dict[str, Array]:
    """(4, 4) of each link in the root, which is the first. Raises _NoTree.

    Not yourdfpy's own: for a chain of 100 links that takes 8 s.
    """
    ends = [end for joint in joints for end in (joint.parent, joint.child)]
    if unknown := next((end for end in ends if end not in links), None):
        raise _NoTree(f"a joint has {brief(unknown)}, which is no link")
    if twice := next((child for child, count in Counter(ends[1::2]).items() if count > 1), None):
        raise _NoTree(f"{brief(twice)} hangs on several joints")
    roots = sorted(set(links) - set(ends[1::2]))
    if len(roots) > 1:
        raise _NoTree(f"{listed(roots)} hang on no joint, and one has to")
    below: dict[str, list[Any]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    poses, waiting = dict.fromkeys(roots, np.eye(4)), [*roots]
    while waiting:
        link = waiting.pop()
        for joint in below.get(link, ()):
            poses[joint.child] = poses[link] @ (np.eye(4) if joint.origin is None else joint.origin)
            waiting.append(joint.child)
    if loop := next((link for link in links if link not in poses), None):
        raise _NoTree(f"{brief(loop)} hangs on itself")
    return poses


@contextmanager
def _quiet() -> Iterator[None]:
    """Without yourdfpy's log: what matters of it is an error."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)
