"""A trained actor in numpy: what evaluation, robots and the training loop itself run."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, TypedDict

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as read_safetensors
from safetensors.numpy import save as pack_safetensors

from adrl.errors import CheckpointError, FileError, brief
from adrl.files import atomic_write_bytes, read_bytes, write_json
from adrl.json_files import checked, read_json
from adrl.types import ACTION_SIZE

F32 = NDArray[np.float32]

SCHEMA_VERSION = 1
WEIGHTS_FILE = "policy.safetensors"
CONFIG_FILE = "config.json"
MAX_MODEL_BYTES = 2**30
DEFAULT = "default"
SHIPPED = {
    DEFAULT: "ships with ADRL: any robot, waypoints of a map",
    "diffbot": "ships with ADRL: diffbot, waypoints of a map",
    "jackal": "ships with ADRL: the Jackal among BARN's cylinders, no map",
}
"""The policies that ship with the package: name -> what each is for."""


Size = Annotated[int, Meta(ge=1, le=65536)]


@dataclass(frozen=True, kw_only=True)
class PolicyConfig:
    """What a policy was trained for. Saved beside its weights."""

    input_size: Size
    """D, the length of an observation."""
    widths: Annotated[tuple[Size, ...], Meta(min_length=1)]
    """Hidden units of each layer."""
    robot: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the RobotConfig; none for a policy of a family."""
    family: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the RobotFamily whose robots it was trained for; none for a policy of one robot."""
    encoder: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the EncoderConfig."""
    guidance: str = "goal"
    method: str = "adrl"
    maturity: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    """S at the end of training; the replanner's thresholds follow it (eq 20)."""
    extra: Mapping[str, Any] = field(default_factory=dict)
    """Anything else that config.json holds: scenario, training time, budget, ..."""

    @property
    def sizes(self) -> tuple[int, ...]:
        """Units of each layer, input and output included."""
        return (self.input_size, *self.widths, ACTION_SIZE)

    def table(self, name: str) -> Mapping[str, Any]:
        """An entry of config.json that holds others, empty where it has none. Raises CheckpointError."""
        entry = self.extra.get(name, {})
        if not isinstance(entry, Mapping):
            raise CheckpointError(
                f"{name} in config.json is {entry!r}, no table of settings; restore the file"
            )
        return entry


class MlpPolicy:
    """tanh(MLP(s)) with ReLU between layers."""

    def __init__(self, layers: Sequence[tuple[F32, F32]], config: PolicyConfig) -> None:
        """layers: (weight (in, out), bias (out,)) from input to output."""
        self.layers = list(layers)
        self.config = config
        # OpenBLAS wakes its threads for larger products. On a busy machine they wait for each other: 64 rows
        # took 8 ms on average instead of 0.16 ms.
        self._block = max(1, 2**18 // max(weight.size for weight, _ in self.layers))

    @cached_property
    def fingerprint(self) -> str:
        """The same for the same weights, and for no others."""
        return fingerprint(*(part.tobytes() for layer in self.layers for part in layer))

    def act(self, observation: F32) -> F32:
        """(N, D) observations -> (N, 2) actions in [-1, 1]: speed, yaw rate."""
        actions = np.empty((len(observation), ACTION_SIZE), np.float32)
        for start in range(0, len(observation), self._block):
            rows = slice(start, start + self._block)
            actions[rows] = self._forward(observation[rows])
        return actions

    def _forward(self, x: F32) -> F32:
        for weight, bias in self.layers[:-1]:
            x = x @ weight
            x += bias
            np.maximum(x, 0.0, out=x)
        weight, bias = self.layers[-1]
        return np.tanh(x @ weight + bias)

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write policy.safetensors and config.json, each at once. Raises OSError."""
        tensors = {}
        for i, (weight, bias) in enumerate(self.layers):
            tensors[f"layers.{i}.weight"] = np.ascontiguousarray(weight, dtype=np.float32)
            tensors[f"layers.{i}.bias"] = np.ascontiguousarray(bias, dtype=np.float32)
        path = Path(folder)
        atomic_write_bytes(path / WEIGHTS_FILE, pack_safetensors(tensors))
        known = asdict(self.config)
        extra = known.pop("extra")
        if not known["family"]:
            del known["family"]
        write_json(path / CONFIG_FILE, {"schema_version": SCHEMA_VERSION} | known | extra)


def fingerprint(*parts: bytes) -> str:
    """Of a policy's content."""
    return sha256(b"".join(parts)).hexdigest()[:16]


def read_model(path: Path, expected: str) -> bytes:
    """The content of another program's file; expected: what to give. Raises CheckpointError."""
    try:
        return read_bytes(path, MAX_MODEL_BYTES)
    except FileError as error:
        raise CheckpointError(f"{path} {error}; give {expected}") from None


def resolve_policy(policy: str | os.PathLike[str]) -> Path:
    """Folder of a policy: a name of SHIPPED, or a run folder. Raises CheckpointError."""
    if str(policy) in SHIPPED:
        return Path(str(resources.files("adrl") / "policies" / str(policy)))
    folder = Path(policy)
    if not folder.is_dir():
        raise CheckpointError(
            f"policy {str(policy)!r}: no such folder; give the folder of a finished training run, "
            f"or one of {', '.join(SHIPPED)}; evaluations also take planners (adrl list)"
        )
    return folder


def load_policy(folder: str | os.PathLike[str]) -> MlpPolicy:
    """Read a policy from a run folder. Raises CheckpointError naming a missing, truncated or foreign file."""
    config = _read_config(Path(folder) / CONFIG_FILE)
    path = Path(folder) / WEIGHTS_FILE
    try:
        tensors = read_safetensors(read_bytes(path, MAX_MODEL_BYTES))
    except FileError as error:
        raise CheckpointError(f"{path} {error}; give the folder of a finished training run") from None
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise CheckpointError(f"{path}: truncated, or not a safetensors file ({brief(error)})") from None
    return MlpPolicy(_layers(path, tensors, config), config)


def _layers(path: Path, tensors: Mapping[str, NDArray[Any]], config: PolicyConfig) -> list[tuple[F32, F32]]:
    layers, expected = [], set()
    for i, (size_in, size_out) in enumerate(zip(config.sizes[:-1], config.sizes[1:], strict=True)):
        pair = []
        for kind, shape in (("weight", (size_in, size_out)), ("bias", (size_out,))):
            name = f"layers.{i}.{kind}"
            expected.add(name)
            tensor = tensors.get(name)
            if tensor is None:
                raise CheckpointError(f"{path}: holds no tensor {name!r}; it is not an ADRL policy")
            if tensor.shape != shape or tensor.dtype != np.float32:
                raise CheckpointError(
                    f"{path}: {name} is {tensor.dtype} {tensor.shape}, {CONFIG_FILE} says float32 {shape}"
                )
            if not np.isfinite(tensor).all():
                raise CheckpointError(f"{path}: {name} holds NaN or infinity")
            pair.append(tensor)
        layers.append((pair[0], pair[1]))
    if foreign := sorted(tensors.keys() - expected):
        raise CheckpointError(
            f"{path}: holds a foreign tensor {foreign[0]!r}; {CONFIG_FILE} is of another policy"
        )
    return layers


class _Environment(TypedDict, total=False):
    worlds: list[str] | None
    replanner: dict[str, Any]
    taken_as: dict[str, Any]
    stop_within_m: Annotated[float, Meta(gt=0.0)]


class _Reward(TypedDict, total=False):
    constants: dict[str, Any]
    maturity: float | None


class _Extra(TypedDict, total=False):
    """What is read of PolicyConfig.extra."""

    schema_version: int
    run: str
    scenario: str
    paper_literal: bool | None
    environment: _Environment
    reward: _Reward
    settings: dict[str, Any]
    train_seconds: float | None
    env_steps: int | None
    gradient_updates: int | None


def _read_config(path: Path) -> PolicyConfig:
    try:
        config = read_json(path, PolicyConfig)
        checked(config.extra, _Extra)
    except FileError as error:
        raise CheckpointError(
            f"{path} {error}; it is not a run's config.json: give the folder of a finished training run"
        ) from None
    extra = dict(config.extra)
    if extra.pop("schema_version", None) != SCHEMA_VERSION:
        raise CheckpointError(
            f"{path}: written by another version of ADRL; schema_version is not {SCHEMA_VERSION}"
        )
    return replace(config, extra=extra)
