"""adrl view."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from adrl.commands.options import load_place, parse
from adrl.commands.progress import console
from adrl.deploy.policy import DEFAULT
from adrl.errors import ConfigError
from adrl.outputs import require_folder
from adrl.view.choices import Offer
from adrl.view.drive import Drive
from adrl.view.messages import Choose
from adrl.view.show import Show
from adrl.worlds.place import Place


@dataclass(frozen=True, kw_only=True)
class ViewOptions(Place):
    """What to look at. On the page all of it can be chosen anew."""

    policy: tuple[str, ...] = (DEFAULT,)
    """One or two that drive: a shipped policy (adrl list), a run folder, model.onnx, an SB3 model.zip, module:object of
    your own, or 'by hand'."""
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
    options = parse(
        ViewOptions, arguments, "view", "Watch and steer drives live, in a browser on this machine."
    )
    require_folder("--out", options.out.absolute().parent)
    # Before anything is loaded: without its extra there is no page.
    from adrl.view.server import serve

    show = _drive(options)
    try:
        serve(show, port=options.port, token=options.token, tell=_tell)
    finally:
        for path in show.close():
            print(path)
    return 0


def _tell(address: str) -> None:
    print(address, flush=True)
    console().print("open this address in a browser on this machine; Ctrl+C ends")


def _drive(options: ViewOptions) -> Show:
    if not 1 <= len(options.policy) <= 2:
        raise ConfigError(f"{len(options.policy)} policies; give one, or two to drive side by side")
    load_place(options)
    text = next((str(place) for place in (options.map, options.world, options.barn) if place), None)
    text = text or options.scenario or "clutter"
    offer = Offer(
        policies=options.policy,
        robots=() if options.robot is None else (options.robot,),
        places={text: options},
    )
    choice = Choose(
        policies=options.policy,
        robot=options.robot or "",
        place=text,
        guidance=options.guidance or "",
        task=options.task,
    )
    return Drive(offer, choice, options.out)
