"""Demonstrations as Minari datasets: HDF5 and JSON, one episode a group; no pickle."""

import copy
import json
import os
import re
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Required, TypedDict
from uuid import uuid4

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from adrl import extras
from adrl.errors import AdrlError, DatasetError, FileError
from adrl.files import require_ordinary, sync
from adrl.imitation.demonstrations import Demonstrations
from adrl.imitation.experts import PERFECT, Expert, find_expert
from adrl.json_files import checked, parse_json, read_json
from adrl.observation import EncoderConfig, ObservationEncoder
from adrl.planning.local_control import TITLES
from adrl.registration import ENV_ID
from adrl.rewards import FEATURES, REWARD_TERMS, RewardConfig, reward
from adrl.rewards.step import reference_period_s
from adrl.types import ACTION_SIZE, RobotConfig
from adrl.worlds.given import training_fingerprints
from adrl.worlds.robot_files import robot_from_fields
from adrl.worlds.robots import load_robot

if TYPE_CHECKING:
    from adrl.envs import NavVectorEnv

PathLike = str | os.PathLike[str]

METADATA_FILE = "metadata.json"
MAX_EPISODES = 10**7
DESCRIPTION_KEY = "adrl"
"""Entry of Minari's metadata that holds Source.description() as JSON."""
INFOS = ("expert_action", "reward_terms", "features")
REWARD_MATURITY = 0.5
"""S under whose weights the stored scalar rewards are formed; ADRL forms its own from reward_terms."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """What demonstrations were recorded in. They fit a learner of the same robot, guidance and encoder."""

    robot: RobotConfig
    encoder: EncoderConfig
    guidance: str
    scenario: str
    demonstrator: str = "A*+DWA with noise"
    """Who drove."""
    worlds: tuple[str, ...] | None = None
    """Fingerprints of the given worlds it was recorded in, see adrl.worlds.given; None where no one knows."""
    extra: Mapping[str, Any] = field(default_factory=dict)
    """Anything else worth keeping, as JSON takes it: seed, noise, split, ..."""

    @classmethod
    def of(cls, env: "NavVectorEnv", *, expert: str | Expert = PERFECT, **extra: Any) -> "Source":
        """What env records of an expert."""
        sim = env.sim
        return cls(
            robot=sim.robot,
            encoder=sim.encoder.config,
            guidance=sim.guidance,
            scenario=env.scenario.name,
            demonstrator=f"{TITLES[env.expert]}, expert {find_expert(expert)}, with noise",
            worlds=tuple(sorted(training_fingerprints(env.scenario))),
            extra={"expert": str(find_expert(expert))} | extra,
        )

    def description(self) -> dict[str, Any]:
        """The same as JSON gives it back, with the version of ADRL."""
        from adrl import __version__

        fields = asdict(self) | {"encoder": self.encoder.fields()}
        return json.loads(json.dumps({"version": __version__} | fields, allow_nan=False))


def require_minari() -> None:
    """Raises MissingExtra where no dataset can be written or read; to be asked before anybody drives for one."""
    extras.require("train", "a dataset of demonstrations")


def save_minari(demonstrations: Demonstrations, path: PathLike, source: Source) -> None:
    """Write a Minari dataset into the new folder `path`, at once: it is there with all in it, or not at all.

    minari.MinariDataset(path / "data") opens it, and so does minari.load_dataset with MINARI_DATASETS_PATH
    set to the folder above when the name ends in a version such as "-v0". recover_environment() works for the
    scenarios that go by a name. Raises DatasetError if path exists already or observations do not chain,
    MissingExtra without Minari, and OSError.
    """
    require_minari()
    target = Path(path).absolute()  # Minari joins a relative one to itself
    if target.exists() and not (target.is_dir() and not any(target.iterdir())):
        raise DatasetError(f"{path}: exists already; give another folder or delete it")
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.name[:200]}.{uuid4().hex}.tmp")
    try:
        _write(demonstrations, temporary, target.name, source)
        for written in (*temporary.rglob("*"), temporary):
            sync(written)
        os.replace(temporary, target)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    sync(target.parent)


def load_minari(path: PathLike, expected: Source | None = None) -> Demonstrations:
    """Read a Minari dataset: one of save_minari, or any other with the same spaces.

    path is the dataset's folder or the "data" folder in it. Others' datasets need the infos reward_terms and
    features (minari.DataCollector with record_infos=True stores them); where expert_action is missing, what
    was done counts as what the expert says. An episode that breaks off is marked truncated. expected: what
    the data must fit. What minari.combine_datasets or a recorder of Minari has made is compared by its env_spec; where
    that is missing, or of another environment, only the spaces can be compared. Raises DatasetError, and
    MissingExtra without Minari.
    """
    require_minari()
    folder = _data_folder(Path(path))
    try:
        metadata = _metadata(folder)
        description = _description(metadata)
        episodes = _read(folder)
        if expected is not None:
            _check_source(description, expected)
        parts = [_columns(episode) for episode in episodes if len(episode["rewards"]) > 0]
        if not parts:
            raise DatasetError("holds no step")
        sizes = {part["observation"].shape[1] for part in parts}
        size = ObservationEncoder(expected.robot, expected.encoder).size if expected else min(sizes)
        if sizes != {size}:
            raise DatasetError(f"has observations of {max(sizes - {size})} numbers, {size} are wanted")
        if expected is not None and description is None:
            _check_source(_by_env_spec(metadata), expected)
        columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        robot = expected.robot if expected else _robot(description)
        periods = np.full(len(columns["action"]), _periods(robot))
        return Demonstrations(**columns, periods=periods)
    except DatasetError as error:
        raise DatasetError(f"{path}: {error}") from None
    except Exception as error:  # What a damaged file makes Minari and h5py raise is not documented.
        raise DatasetError(f"{path}: truncated, or not a Minari dataset ({error})") from error


def recorded_worlds(path: PathLike) -> set[str] | None:
    """Fingerprints of the given worlds a dataset was recorded in; None where it does not say. Raises DatasetError."""
    try:
        worlds = (_description(_metadata(_data_folder(Path(path)))) or {}).get("worlds")
    except DatasetError as error:
        raise DatasetError(f"{path}: {error}") from None
    return None if worlds is None else set(worlds)


def _write(data: Demonstrations, root: Path, name: str, source: Source) -> None:
    import minari
    from gymnasium import spaces
    from minari.data_collector.episode_buffer import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    (root / "data").mkdir(parents=True)
    limit = ObservationEncoder(source.robot, source.encoder).limit
    storage = MinariStorage.new(
        root / "data",
        observation_space=spaces.Box(-limit, limit, data.observation.shape[1:], np.float32),
        action_space=spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32),
        env_spec=_env_spec(source),
    )
    stem = re.sub(r"[^-\w]+", "-", name)
    description = source.description()
    storage.update_metadata(
        {
            "dataset_id": stem if re.search(r"-v\d+$", stem) else f"{stem}-v0",
            "minari_version": minari.__version__,
            "algorithm_name": source.demonstrator,
            "description": f"Demonstrations for {ENV_ID}: the action executed; in infos the expert's, the "
            f"reward's terms {', '.join(REWARD_TERMS)} and the features {', '.join(FEATURES)}.",
            "requirements": [f"adrl>={description['version']}"],
            DESCRIPTION_KEY: json.dumps(description),
        }
    )
    if data.reward_terms.shape[1] != len(REWARD_TERMS):
        raise DatasetError(
            f"a step has {data.reward_terms.shape[1]} reward terms; a dataset holds the {len(REWARD_TERMS)} built-in "
            "ones: collect it without reward.extra_terms"
        )
    rewards = reward(data.reward_terms, data.features, REWARD_MATURITY, RewardConfig())
    last = np.flatnonzero(data.ended)
    buffers = []
    for first, end in zip([0, *(last[:-1] + 1)], last + 1, strict=True):
        steps = slice(first, end)
        if not np.array_equal(data.observation[first + 1 : end], data.next_observation[first : end - 1]):
            raise DatasetError(
                f"steps {first} to {end - 1} are no episode: a successor is not the next observation"
            )
        buffers.append(
            EpisodeBuffer(
                observations=np.concatenate([data.observation[steps], data.next_observation[end - 1 : end]]),  # pyright: ignore
                actions=data.action[steps],  # pyright: ignore
                rewards=rewards[steps],
                terminations=data.terminated[steps],  # pyright: ignore
                truncations=data.truncated[steps],  # pyright: ignore
                infos={name: getattr(data, name)[steps] for name in INFOS},
            )
        )
    storage.update_episodes(buffers)


def _env_spec(source: Source) -> Any:
    """How Gymnasium makes the environment anew; None where it takes more than names and numbers."""
    import gymnasium

    from adrl.worlds import SCENARIOS

    if source.scenario not in SCENARIOS:
        return None
    spec = copy.copy(gymnasium.spec(ENV_ID))  # what it gives is the registry's own
    names = ("scenario", "guidance", "robot", "encoder")
    description = source.description()
    spec.kwargs = {name: description[name] for name in names}
    return spec


def _data_folder(path: Path) -> Path:
    if not path.is_dir():
        raise DatasetError(f"{path}: no such folder; give the folder of a Minari dataset")
    for folder in (path, path / "data"):
        if (folder / METADATA_FILE).is_file():
            return folder
    raise DatasetError(f"{path}: not a Minari dataset: it holds no {METADATA_FILE}")


class _Metadata(TypedDict, total=False):
    """What is read of Minari's metadata.json. Others of its entries hold JSON as text."""

    observation_space: Required[str]
    action_space: Required[str]
    data_format: Required[str]
    total_episodes: Required[Annotated[int, Meta(ge=0, le=MAX_EPISODES)]]
    env_spec: str | None
    adrl: str


class _Description(TypedDict, total=False):
    """What is read of Source.description()."""

    robot: Required[dict[str, Any]]
    encoder: Required[dict[str, Any]]
    guidance: Required[str]
    worlds: list[str] | None


class _EnvSpec(TypedDict, total=False):
    kwargs: dict[str, Any] | None


def _metadata(folder: Path) -> _Metadata:
    """Raises DatasetError."""
    path = folder / METADATA_FILE
    try:
        return read_json(path, _Metadata)
    except FileError as error:
        raise DatasetError(f"{METADATA_FILE} {error}; write it with Minari >= 0.5") from None


def _description(metadata: _Metadata) -> dict[str, Any] | None:
    """Source.description() of who recorded it; None where it was not ADRL. Raises DatasetError."""
    if "adrl" not in metadata:
        return None
    try:
        description = parse_json(metadata["adrl"], dict[str, Any])
        checked(description, _Description)
    except FileError as error:
        raise DatasetError(f"{DESCRIPTION_KEY} in {METADATA_FILE} {error}; collect it again") from None
    return description


def _robot(description: Mapping[str, Any] | None) -> RobotConfig | None:
    """The robot it was recorded with; None where it does not say."""
    return None if description is None else robot_from_fields(description["robot"])


def _periods(robot: RobotConfig | None) -> float:
    """Length of a robot's step in reference periods; 1 of a robot that is not known."""
    return 1.0 if robot is None else robot.control_period_s / reference_period_s(robot.max_speed_mps)


def _read(folder: Path) -> list[dict[str, Any]]:
    """Episodes as Minari stores them. Never makes an environment: a dataset runs no code."""
    from gymnasium import spaces
    from minari.dataset.minari_storage import MinariStorage

    for path in folder.glob("*.hdf5"):
        require_ordinary(path)
    storage = MinariStorage.read(folder)
    observation, action = storage.observation_space, storage.action_space
    if not (isinstance(observation, spaces.Box) and len(observation.shape) == 1):
        raise DatasetError(f"observation space is {observation}; a flat Box as of {ENV_ID} is wanted")
    if not (isinstance(action, spaces.Box) and action.shape == (ACTION_SIZE,)):
        raise DatasetError(f"action space is {action}; Box(-1, 1, ({ACTION_SIZE},)) as of {ENV_ID} is wanted")
    return list(storage.get_episodes(range(storage.total_episodes)))


def _columns(episode: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """One episode of T steps as the arrays of Demonstrations."""
    steps, name = len(episode["rewards"]), f"episode {episode['id']}"
    infos = episode["infos"] or {}
    lacking = [key for key in ("reward_terms", "features") if key not in infos]
    if lacking:
        raise DatasetError(
            f"{name} has no {' and no '.join(lacking)} in its infos, which form the reward (eq 17); "
            f"record {ENV_ID} with `adrl collect` or minari.DataCollector(env, record_infos=True)"
        )
    observations = np.asarray(episode["observations"], dtype=np.float32)
    action = np.asarray(episode["actions"], dtype=np.float32)
    truncated = np.asarray(episode["truncations"], dtype=bool) & ~np.asarray(
        episode["terminations"], dtype=bool
    )
    columns = {
        "observation": observations[:-1],
        "next_observation": observations[1:],
        "action": action,
        # DataCollector also stores the infos of reset(), first.
        "expert_action": np.asarray(infos.get("expert_action", action), dtype=np.float32)[-steps:],
        "reward_terms": np.asarray(infos["reward_terms"], dtype=np.float32)[-steps:],
        "features": np.asarray(infos["features"], dtype=np.float32)[-steps:],
        "terminated": np.asarray(episode["terminations"], dtype=bool),
        "truncated": truncated,
    }
    for key, column in columns.items():
        if len(column) != steps:
            raise DatasetError(f"{name} has {steps} rewards but {len(column)} rows of {key}")
    if (columns["terminated"] | truncated)[:-1].any():
        raise DatasetError(f"{name} goes on after its end")
    for key in ("action", "expert_action"):
        if not (np.abs(columns[key]) <= 1.0).all():
            raise DatasetError(f"{name} has {key} outside [-1, 1]; actions are normalised speed and yaw rate")
    truncated[-1] = not columns["terminated"][-1]
    return columns


def _by_env_spec(metadata: _Metadata) -> Mapping[str, Any] | None:
    """Source.description() of the environment that the metadata's env_spec would make; None where it is another's.

    Nothing is made: its arguments are read. Raises DatasetError.
    """
    from adrl.envs import NavVectorEnv

    try:
        spec = parse_json(metadata.get("env_spec") or "{}", dict[str, Any])
        if spec.get("id") != ENV_ID:
            return None
        kwargs = checked(spec, _EnvSpec).get("kwargs") or {}
    except FileError as error:
        raise DatasetError(f"env_spec in {METADATA_FILE} {error}; collect it again") from None
    given = {name: option.default for name, option in signature(NavVectorEnv).parameters.items()}
    try:
        given |= kwargs
        robot, encoder = given["robot"], given["encoder"]
        return Source(
            robot=robot_from_fields(robot) if isinstance(robot, Mapping) else load_robot(robot),
            encoder=EncoderConfig(**(encoder or {})),
            guidance=given["guidance"],
            scenario=given["scenario"],
        ).description()
    except (AdrlError, TypeError, ValueError) as error:
        raise DatasetError(
            f"has an env_spec that makes no environment here ({error}); collect it again"
        ) from None


def _check_source(description: Mapping[str, Any] | None, expected: Source) -> None:
    if description is None:
        return
    wanted = expected.description()
    for part in ("guidance", "robot", "encoder"):
        difference = _difference(part, description[part], wanted[part])
        if difference is not None:
            name, found, want = difference
            raise DatasetError(f"was recorded with {name} = {found}, {want} is wanted; collect it again")


def _difference(name: str, found: Any, wanted: Any) -> tuple[str, Any, Any] | None:
    """The first entry in which two JSON values differ; a robot may go by another name."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in {**wanted, **found}:
            if name == "robot" and key == "name":
                continue
            difference = _difference(f"{name}.{key}", found.get(key), wanted.get(key))
            if difference is not None:
                return difference
        return None
    return None if found == wanted else (name, found, wanted)
