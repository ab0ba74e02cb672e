"""A robot's file with the source of each number, and the command that drives it."""

import shlex
from collections.abc import Mapping
from pathlib import Path

from adrl.descriptions.findings import ASSUMED, TURNING_RADIUS, Finding, Standing, shown
from adrl.errors import ConfigError
from adrl.types import RobotConfig
from adrl.worlds.robot_files import robot_from_fields, robot_toml

MEANING = {Standing.LIMIT: ", a limit", Standing.HINT: ", a hint"}
ASSUMPTIONS = {
    "lag_s": "adrl calibrate fits it to a recorded drive",
    "latency_s": "adrl calibrate fits it to a recorded drive",
    "odometry_drift": "no error of the odometry",
    "lidar.noise_std_m": "see the LiDAR's data sheet",
    "lidar.dropout_probability": "no beams are lost",
}


def robot_of(name: str, chosen: Mapping[str, Finding]) -> RobotConfig:
    """The robot of settled findings; what nobody says of ASSUMED keeps its default. Raises ConfigError."""
    top: dict[str, object] = {"name": name, "lidar": (lidar := {})}
    for field in RobotConfig.__dataclass_fields__:
        if field in chosen:
            top[field] = chosen[field].value
    for field, finding in chosen.items():
        if field.startswith("lidar."):
            lidar[field.removeprefix("lidar.")] = finding.value
    try:
        return robot_from_fields(top)
    except ConfigError as error:
        raise ConfigError(f"{error}; give another value with --set") from None


def robot_text(robot: RobotConfig, chosen: Mapping[str, Finding], out: Path | None) -> str:
    """The robot's TOML, each line with its source; on top the command that drives the robot."""
    lines = [f"# {drive_command(chosen, out)}", ""]
    table = ""
    for line in robot_toml(robot).splitlines():
        if line.startswith("["):
            table = f"{line.strip('[]')}."
        name = f"{table}{line.partition(' = ')[0]}"
        if name in chosen:
            line = f"{line}  # {_comment(chosen[name])}"
        elif name == TURNING_RADIUS:
            line = f"{line}  # turns on the spot: no source says that it is car-like"
        elif name in ASSUMED:
            line = f"{line}  # the default: no source says it; {ASSUMPTIONS[name]}"
        lines.append(line)
    return "\n".join(lines) + "\n"


def _comment(finding: Finding) -> str:
    text = finding.place + MEANING.get(finding.standing, "")
    return "".join(letter for letter in text if letter.isprintable())


def drive_command(chosen: Mapping[str, Finding], out: Path | None) -> str:
    """What drives the robot by its topics and frames, for a shell."""
    said = {name: finding.value for name, finding in chosen.items()}
    ros = said.get("ros", "ros2")
    words = ["adrl", ros, "drive", "--robot", str(out or "ROBOT.toml")]
    for field in ("odom_frame", "map_frame", "base_frame"):
        if field in said:
            words += [f"--{field.replace('_', '-')}", said[field]]
    if said.get("stamped"):
        words.append("--stamped")
    if "sensor_yaw_rad" in said:
        mount = (said["lidar.mount_x_m"], said["lidar.mount_y_m"], said["sensor_yaw_rad"])
        words += ["--mount", *map(shown, mount)]
    topics = [
        (topic, said[name])
        for topic, name in (("scan", "scan_topic"), ("odom", "odom_topic"))
        if name in said
    ]
    remapped = [f"{topic}:={name}" for topic, name in topics if name.strip("/") != topic]
    if remapped and ros == "ros2":
        words.append("--ros-args")
    for remap in remapped:
        words += ["-r", remap] if ros == "ros2" else [remap]
    return " ".join(map(_quoted, words))


def _quoted(word: str) -> str:
    return shlex.quote("".join(letter for letter in word if letter.isprintable()))
