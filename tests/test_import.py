"""`import adrl` is light, its API is looked up on use, adrl/Nav-v0 is registered in either order."""

import importlib
import subprocess
import sys
from importlib.metadata import version

import pytest

import adrl

HEAVY = ("jax", "gymnasium", "matplotlib", "minari", "h5py", "optax", "scipy")


def run(code: str) -> str:
    """What a new interpreter prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "WARN" not in done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize(
    "module", ["adrl", "adrl.deploy", "adrl.deploy.policy", "adrl.imitation", "adrl.rewards"]
)
def test_module_is_light(module: str) -> None:
    loaded = run(f"import sys, {module}; print([m for m in {HEAVY} if m in sys.modules])")
    assert loaded == "[]"


MAKE = "e = gymnasium.make('{0}', scenario='clutter', robot='diffbot'); print(type(e.unwrapped).__name__)"


@pytest.mark.parametrize(
    ("imports", "name"),
    [
        ("import adrl, gymnasium", "adrl/Nav-v0"),
        ("import gymnasium, adrl", "adrl/Nav-v0"),
        ("import gymnasium", "adrl:adrl/Nav-v0"),
        ("import gymnasium", "adrl.envs:adrl/Nav-v0"),
    ],
)
def test_make_works_in_any_order_of_imports(imports: str, name: str) -> None:
    assert run(f"{imports}; {MAKE.format(name)}") == "NavEnv"


def test_registering_leaves_no_trace_on_gymnasium() -> None:
    """Looking for Gymnasium without importing it neither registers nor spoils it; it keeps its own loader."""
    printed = run(
        "import importlib.util, sys, adrl; spec = importlib.util.find_spec('gymnasium')\n"
        "assert 'gymnasium' not in sys.modules and spec.loader.get_filename('gymnasium') == spec.origin\n"
        "import gymnasium; loader = gymnasium.__spec__.loader\n"
        "assert loader is gymnasium.__loader__ and type(loader).__module__ == '_frozen_importlib_external'\n"
        "assert 'adrl.envs' not in sys.modules\n"
        "print(gymnasium.registry['adrl/Nav-v0'].entry_point)"
    )
    assert printed == "adrl.envs:NavEnv"


def test_import_works_without_gymnasium() -> None:
    """A robot has no Gymnasium: nothing fails until it is asked for, and then with Python's own error."""
    printed = run(
        "import sys\n"
        "class Hide:\n"
        " def find_spec(self, name, *_):\n"
        "  if name == 'gymnasium': raise ModuleNotFoundError(name)\n"
        "sys.meta_path.insert(0, Hide())\n"
        "import adrl.deploy\n"
        "try: import gymnasium\nexcept ModuleNotFoundError as error: print(error)"
    )
    assert printed == "gymnasium"


def test_version_is_the_installed_one() -> None:
    assert adrl.__version__ == version("adrl")


@pytest.mark.parametrize("name", sorted(set(adrl.__all__) - {"ENV_ID", "__version__"}))
def test_api_is_looked_up_on_first_use(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(adrl.__dict__, name, raising=False)
    assert getattr(adrl, name) is getattr(importlib.import_module("adrl.api"), name)
    assert name in adrl.__dict__, "looked up once"


def test_unknown_attribute() -> None:
    with pytest.raises(AttributeError, match="no attribute 'trian'"):
        _ = adrl.trian  # pyright: ignore[reportAttributeAccessIssue]
    assert not hasattr(adrl, "__path_to_nowhere__")
    assert {"train", "evaluate", "load_policy", "__version__"} <= set(dir(adrl))


@pytest.mark.parametrize(
    ("before", "now"),
    [
        ("adrl.integrations.driver", "adrl.deploy.driver"),
        ("adrl.integrations.localisation", "adrl.deploy.localisation"),
        ("adrl.motion", "adrl.observation.motion"),
        ("adrl.poses", "adrl.geometry"),
    ],
)
def test_modules_that_moved_are_found_by_their_names_of_before(before: str, now: str) -> None:
    old, new = importlib.import_module(before), importlib.import_module(now)
    assert old.__all__
    assert all(getattr(old, name) is getattr(new, name) for name in old.__all__)
