"""A model that adrl export wrote, run by ONNX Runtime: the encoder is inside, so it takes measurements."""

from pathlib import Path
from typing import Annotated, Any, TypedDict

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from adrl.deploy.policy import fingerprint, read_model
from adrl.errors import CheckpointError, ConfigError, FileError, MissingExtra, brief
from adrl.json_files import parse_json
from adrl.observation import EncoderConfig, Measurements
from adrl.observation.tracks import Tracks
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import RobotConfig
from adrl.worlds.robot_files import robot_from_fields

INPUTS = ("ranges", "goal", "twist", "last_action")
PAST_INPUTS = ("past_ranges", "pose", "past_pose")
"""Those of a model with motion cues beside these."""
MORE_INPUTS = ("tracks", "path")
"""Those of a model with these components."""
METADATA = ("robot", "encoder", "guidance", "method", "maturity")


class _Encoder(TypedDict, total=False):
    history_steps: Annotated[int, Meta(ge=0, le=50)]
    num_tracks: int
    path: bool
    near_m: float
    reach_m: float | None
    body: bool


class OnnxPolicy:
    """See load_onnx. What it was trained for stands in the model."""

    encoder_inside = True

    def __init__(self, session: Any, name: str, fingerprint: str) -> None:
        """session: of ONNX Runtime, with the model. Raises CheckpointError for one that adrl export did not write."""
        self.name, self.fingerprint = name, fingerprint
        self._session = session
        inputs = tuple(spec.name for spec in session.get_inputs())
        about = session.get_modelmeta().custom_metadata_map
        if not (
            {*INPUTS} <= {*inputs} <= {*INPUTS, *PAST_INPUTS, *MORE_INPUTS} and about.keys() >= {*METADATA}
        ):
            raise CheckpointError(
                f"{name}: not a model of adrl export --onnx (inputs {', '.join(inputs)}); give a policy of your own as "
                "module:object, see docs/guide/policy.md"
            )
        self._inputs = inputs
        try:
            encoder = parse_json(about["encoder"], _Encoder)
            self.robot: RobotConfig = robot_from_fields(parse_json(about["robot"], dict[str, Any]))
            self.told_of_body = encoder.pop("body", False)
            config = EncoderConfig(**encoder)
            tracks = Tracks([self.robot], config) if config.num_tracks > 0 else None
            self.encoder = Measurements(config.history_steps, tracks, needs_path=config.path)
            self.replanner = ReplannerConfig(**parse_json(about.get("replanner", "{}"), dict[str, Any]))
            self.maturity = parse_json(about["maturity"], float)
            self.stop_within_m = float(about.get("stop_within_m", "inf"))
        except (TypeError, ConfigError, FileError) as error:
            raise CheckpointError(
                f"{name}: its metadata is damaged ({brief(error)}); export it again"
            ) from None
        self.guidance, self.method = about["guidance"], about["method"]

    def act(self, observation: NDArray[np.floating]) -> NDArray[np.float32]:
        """(N, D) measurements of its robot -> (N, 2) actions in [-1, 1]."""
        measured = self.encoder.split(observation)._asdict()
        given = {
            name: np.ascontiguousarray(measured[name], np.float64 if name in PAST_INPUTS[1:] else np.float32)
            for name in self._inputs
        }
        return self._session.run(["action"], given)[0]


def load_onnx(path: Path) -> OnnxPolicy:
    """The policy in a file that adrl export wrote. Raises MissingExtra without ONNX Runtime, CheckpointError."""
    content = read_model(path, "what adrl export RUN --onnx wrote")
    try:
        import onnxruntime
    except ImportError:
        raise MissingExtra.named("onnxruntime", "a policy in ONNX") from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # of a type that onnxruntime keeps to itself
        raise CheckpointError(f"{path}: not a readable ONNX model ({brief(error)})") from None
    return OnnxPolicy(session, path.name, fingerprint(content))
