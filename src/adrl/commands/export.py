"""adrl export."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from adrl import files
from adrl.commands.options import parse
from adrl.deploy.policy import SHIPPED, load_policy, resolve_policy
from adrl.errors import ConfigError
from adrl.export.onnx_graph import to_onnx
from adrl.export.plain import to_safetensors
from adrl.outputs import require_file
from adrl.worlds import load_robot


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """What to write, and in which form."""

    policy: Positional[str]
    """a shipped policy (adrl list), or a run folder."""
    onnx: bool = False
    """An ONNX model: ranges, goal, twist and last action in, action and velocity out; the encoder is inside."""
    safetensors: bool = False
    """Weights and encoder tables in one file, as examples/cpp reads it."""
    robot: str | None = None
    """For a policy of a family: the robot that drives, a name (adrl list) or a TOML file."""
    out: Path | None = None
    """The file; policy.onnx in the run folder, or policy.plain.safetensors, when left out."""


def main(arguments: Sequence[str]) -> int:
    """Write a policy for other programs."""
    options = parse(ExportOptions, arguments, "export", "Write a policy for programs that are not Python.")
    if options.onnx == options.safetensors:
        raise ConfigError("give one of --onnx and --safetensors")
    require_file("--out", options.out)
    folder = resolve_policy(options.policy)
    if options.out is None and options.policy in SHIPPED:
        raise ConfigError("a shipped policy's folder is not yours to write to; give --out FILE")
    out = options.out or folder / ("policy.onnx" if options.onnx else "policy.plain.safetensors")
    policy = load_policy(folder)
    robot = None if options.robot is None else load_robot(options.robot)
    files.atomic_write_bytes(out, (to_onnx if options.onnx else to_safetensors)(policy, robot))
    print(out)
    return 0
