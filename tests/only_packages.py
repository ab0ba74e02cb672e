"""Runs code as if only some packages were installed, with what they depend on."""

import json
import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, packages_distributions, requires

ONLY = """
import json, sys
from pathlib import Path
allowed, arguments = json.loads(sys.argv[1]), json.loads(sys.argv[2])
class Only:
    def __init__(self, finder):
        self.finder = finder
    def __getattr__(self, name):
        return getattr(self.finder, name)
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        ours = top == "adrl" or top.startswith(("_adrl", "_sysconfigdata"))
        known = ours or top in allowed or top in sys.stdlib_module_names
        return self.finder.find_spec(name, path, target) if known else None
sys.meta_path[:] = map(Only, sys.meta_path)
"""
COMMAND = "from adrl.cli import main; sys.exit(main(arguments))"


def modules_of(packages: list[str]) -> list[str]:
    """Top-level modules that installing these would bring, with what they depend on."""
    found: set[str] = set()
    waiting = list(packages)
    while waiting:
        package = canonical(re.split(r"[^\w.-]", waiting.pop())[0])
        if package in found:
            continue
        try:
            needs = requires(package) or []
        except PackageNotFoundError:  # for another Python or system
            continue
        found.add(package)
        waiting += [need for need in needs if "extra ==" not in need]
    return [
        module for module, names in packages_distributions().items() if found & set(map(canonical, names))
    ]


def canonical(name: str) -> str:
    """A package's name, however it is written."""
    return re.sub(r"[-_.]+", "-", name).lower()


def run_with(packages: list[str], code: str, arguments: list[str]) -> subprocess.CompletedProcess[str]:
    allowed, given = json.dumps(modules_of(packages)), json.dumps(arguments)
    return subprocess.run(
        [sys.executable, "-c", ONLY + code, allowed, given], capture_output=True, text=True, check=False
    )
