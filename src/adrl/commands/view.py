"""adrl view."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from adrl.agents import checkpoint
from adrl.bags.reader import COMMAND_TOPIC, ODOMETRY_TOPIC, SCAN_TOPIC
from adrl.commands.options import given, load_place, parse, refuse
from adrl.commands.progress import console
from adrl.commands.ros2 import ROS_ARGUMENTS, split
from adrl.deploy.policies import DEFAULT_ROBOT
from adrl.deploy.policy import CONFIG_FILE, DEFAULT
from adrl.errors import CheckpointError, ConfigError, FileError
from adrl.imitation import BagTopics
from adrl.outputs import require_folder
from adrl.registry import listed
from adrl.report.source import read_run
from adrl.view.choices import Offer
from adrl.view.drive import Drive
from adrl.view.messages import Choose
from adrl.view.recording import Replay
from adrl.view.server import serve
from adrl.view.show import Show
from adrl.worlds import SCENARIOS, load_robot
from adrl.worlds.place import Place

OF_ALL = {"robot", "port", "token"}
"""Options that do something whatever is shown."""
OF_PEOPLE = {"people", "people_share", "legs"}
OF_BAGS = {"scan_topic", "odometry_topic", "command_topic"}


@dataclass(frozen=True, kw_only=True)
class ViewOptions(Place):
    """What to look at. On the page all of it can be chosen anew."""

    run: Annotated[Path | None, tyro.conf.Positional] = None
    """Folder of a training run: its policy drives where it was trained."""
    follow: bool = False
    """Watch the run as it goes on: its curves, and its newest policy driving."""
    bag: Path | None = None
    """Replay a ROS 1 bag or the folder of a ROS 2 bag instead (extra bags); --robot is the one that drove."""
    ros2: bool = False
    """Watch a robot instead, or adrl ros2 sim, by its topics in ROS 2; --robot is the one that drives. ROS's own
    arguments go with it: --ros-args -r scan:=front/scan."""
    scan_topic: str = SCAN_TOPIC
    """Topic of the bag's scans."""
    odometry_topic: str = ODOMETRY_TOPIC
    """Topic of its odometry."""
    command_topic: str = COMMAND_TOPIC
    """Topic of its commands."""
    policy: tuple[str, ...] = ()
    """One or two that drive, or one beside the run: a shipped policy (adrl list), a run folder, model.onnx, an SB3
    model.zip, module:object of your own, or 'by hand'. Left out: the run's, or else default."""
    robot: str | None = None
    """A robot's name (adrl list) or a TOML file; the one the policy was trained on when left out."""
    guidance: Literal["goal", "replan", "map"] | None = None
    """As trained when left out."""
    task: int = 0
    """Number of the task to begin with."""
    out: Path = Path("demonstrations")
    """Folder of the Minari dataset that recorded drives are saved to."""
    port: int | None = None
    """Of the page on 127.0.0.1; 8765 when left out, or a free one where that is taken."""
    token: str | None = None
    """The secret in the page's address, drawn anew when left out. With the one of before, and the port, open pages find
    the new server by themselves."""


def main(arguments: Sequence[str]) -> int:
    """Serve the page until the command is ended."""
    ours, theirs = split(arguments)
    options = parse(ViewOptions, ours, "view", "Watch and steer drives live, in a browser on this machine.")
    require_folder("--out", options.out.absolute().parent)
    if theirs and not options.ros2:
        raise ConfigError(f"{ROS_ARGUMENTS} go with --ros2")
    with ExitStack() as while_shown:
        show = _robot(options, theirs, while_shown) if options.ros2 else _show(options)
        try:
            serve(show, port=options.port, token=options.token, tell=_tell)
        finally:
            for path in show.close():
                print(path)
    return 0


def _robot(options: ViewOptions, ros_arguments: Sequence[str], while_shown: ExitStack) -> Show:
    """A robot that topics tell of. Raises AdrlError."""
    if options.run is not None or options.bag is not None:
        raise ConfigError("give one of a run, --bag and --ros2")
    refuse(
        options,
        given(options).keys() - {"ros2", *OF_ALL},
        "would do nothing: --ros2 shows what a robot's topics tell; leave it out",
    )
    robot = load_robot(options.robot or DEFAULT_ROBOT)
    from adrl.integrations.ros2.watch import watching  # ROS 2 is not everywhere
    from adrl.view.robot import Robot

    return Robot(while_shown.enter_context(watching(robot, ros_arguments)), robot)


def _tell(address: str) -> None:
    print(address, flush=True)
    console().print("open this address in a browser on this machine; Ctrl+C ends")


def _show(options: ViewOptions) -> Show:
    """Raises AdrlError."""
    if options.follow and options.run is None:
        raise ConfigError("--follow watches a training run; give its folder: adrl view RUN --follow")
    if options.bag is not None:
        return _replay(options, options.bag)
    refuse(options, OF_BAGS, "is for bags; give --bag too")
    if options.follow and options.policy:
        raise ConfigError("--follow shows the run's newest policy, and --policy another; leave one out")
    run = () if options.run is None else (str(options.run),)
    policies = (*run, *options.policy) or (DEFAULT,)
    if not 1 <= len(policies) <= 2:
        told = f"{len(policies)} policies{', the run among them' if run else ''}"
        raise ConfigError(f"{told}; give one, or two to drive side by side")
    place = options
    if options.run is not None and not _names_a_place(options):
        people = {name: value for name, value in given(options).items() if name in OF_PEOPLE}
        place = replace(_place_of(options.run), **people)
    load_place(place)
    text = next((str(path) for path in (place.map, place.world, place.barn) if path), None)
    text = text or str(place.scenario or "clutter")
    offer = Offer(
        policies=() if options.follow else policies,
        robots=() if options.robot is None else (options.robot,),
        places={text: place},
    )
    choice = Choose(
        policies=policies,
        robot=options.robot or "",
        place=text,
        guidance=options.guidance or "",
        people=place.people,
        task=options.task,
    )
    if options.run is not None and options.follow:
        from adrl.view.training import Training

        return Training(options.run, offer, choice, options.out)
    return Drive(offer, choice, options.out)


def _replay(options: ViewOptions, bag: Path) -> Replay:
    """Raises AdrlError."""
    if options.run is not None:
        raise ConfigError("give a run or --bag, not both")
    refuse(
        options,
        given(options).keys() - {"bag", *OF_BAGS, *OF_ALL},
        "would do nothing: --bag shows what was recorded; leave it out",
    )
    topics = BagTopics(
        scan=options.scan_topic, odometry=options.odometry_topic, command=options.command_topic
    )
    return Replay(bag, load_robot(options.robot or DEFAULT_ROBOT), topics)


def _names_a_place(options: ViewOptions) -> bool:
    return any(place is not None for place in (options.scenario, options.map, options.world, options.barn))


def _place_of(run: Path) -> Place:
    """Where a run trains, as far as its files say it; of several scenarios the first. Raises AdrlError."""
    if (run / CONFIG_FILE).exists():
        try:
            return Place.of(read_run(run).get("settings", {})).first
        except FileError as error:
            raise CheckpointError(f"{run / CONFIG_FILE}: settings {error}; restore the file") from None
    names = str((checkpoint.settings(run).get("environment") or {}).get("scenario"))
    scenario = next(iter(listed(names)), None)
    return Place(scenario=scenario) if scenario in SCENARIOS else Place()
