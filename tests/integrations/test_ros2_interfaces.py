"""What scripts/ros2-interfaces makes of the definitions in interfaces/."""

import json
import re
import subprocess
from pathlib import Path

import pytest

from integrations.conftest import require_ros2

DEFINITIONS = Path(__file__).resolve().parents[2] / "interfaces"
TELL = """
import importlib, json, sys
out = {}
for kind in sys.argv[1:]:
    package, folder, name = kind.split("/")
    made = getattr(importlib.import_module(f"{package}.{folder}"), name)
    names = {"msg": [], "srv": ["Request", "Response"], "action": ["Goal", "Result", "Feedback"]}[folder]
    parts = [getattr(made, name) for name in names] or [made]
    constants = {}
    for part in parts:
        constants |= next(value for key, value in vars(type(part)).items() if key.endswith("__constants"))
    out[kind] = [[part.get_fields_and_field_types() for part in parts], constants]
print(json.dumps(out))
"""
LONG = {"bool": "boolean", "float32": "float", "float64": "double"}


def in_long(kind: str, package: str) -> str:
    """A field's type as rosidl writes it."""
    base, array = kind.removesuffix("[]"), kind.endswith("[]")
    if "/" not in base and base[0].isupper():
        base = f"{package}/{base}"
    base = LONG.get(base, base)
    return f"sequence<{base}>" if array else base


def defined(file: Path) -> tuple[list[dict[str, str]], dict[str, int]]:
    """Fields of each part, and constants."""
    package = file.parents[1].name
    parts: list[dict[str, str]] = [{}]
    constants: dict[str, int] = {}
    for line in file.read_text().splitlines():
        if line == "---":
            parts.append({})
        elif match := re.fullmatch(r"\w+ ([A-Z_]+)=(\d+)", line):
            constants[match[1]] = int(match[2])
        else:
            kind, name = line.split()
            parts[-1][name] = in_long(kind, package)
    return parts, constants


@pytest.mark.ros
@pytest.mark.integration
def test_the_modules_have_the_fields_types_and_constants_of_the_definitions() -> None:
    """Installed ones too: a robot's own packages are the same as these."""
    files = sorted(DEFINITIONS.glob("*/*/*.*"))
    kinds = [f"{file.parents[1].name}/{file.parent.name}/{file.stem}" for file in files]
    assert "nav2_msgs/action/FollowPath" in kinds
    told = json.loads(
        subprocess.run([require_ros2(), "-c", TELL, *kinds], check=True, capture_output=True).stdout
    )
    for kind, file in zip(kinds, files, strict=True):
        fields, constants = defined(file)
        assert told[kind] == [fields, constants], kind
