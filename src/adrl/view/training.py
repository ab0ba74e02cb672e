"""A training run that is watched as it goes on: curves as they grow, and the newest policy driving."""

import dataclasses
from pathlib import Path
from typing import Any

from msgspec import structs

from adrl.agents.metrics import METRICS_FILE
from adrl.deploy.policies import find_policy
from adrl.errors import AdrlError, CheckpointError
from adrl.report.document import charts
from adrl.report.source import Source
from adrl.runs.newest import newest_policy
from adrl.view.choices import Offer
from adrl.view.drive import Drive
from adrl.view.messages import Choose, Message

LOOK_S = 1.0
"""So often the run's folder is looked at."""


class Training:
    """A run's folder. There is no drive before its first checkpoint."""

    def __init__(self, folder: Path, offer: Offer, choice: Choose, out: Path) -> None:
        """choice: where the newest policy drives; its policies are not used. Raises CheckpointError."""
        if not (folder / METRICS_FILE).exists():
            raise CheckpointError(
                f"{folder}: holds no {METRICS_FILE}; give the folder of a training run that has begun"
            )
        self._folder, self._offer, self._choice, self._out = folder, offer, choice, out
        self._drive: Drive | None = None
        self._newest = ""
        """Name of the newest policy, which says of which step it is."""
        self._charts: list[dict[str, Any]] = []
        self._size, self._steps, self._looked_s = -1, -1, -LOOK_S
        self.version = 0

    def turn(self, asked: list[Message], now_s: float) -> dict[str, Any]:
        """See Show. A drive that is over is followed by one of the newest policy on the next task."""
        errors, news = [], {}
        if now_s - self._looked_s >= LOOK_S:
            self._looked_s = now_s
            try:
                news = self._look()
                self._next_drive()
            except AdrlError as error:
                errors.append(str(error))
        frame = {"lanes": []} if self._drive is None else self._drive_on(self._drive, asked, now_s)
        errors += frame.get("errors", [])
        return frame | news | ({"errors": errors} if errors else {})

    def _drive_on(self, drive: Drive, asked: list[Message], now_s: float) -> dict[str, Any]:
        frame, version = drive.turn(asked, now_s), drive.version
        if version != self._driven_version:
            self._driven_version = version
            self.version += 1
        return frame

    _driven_version = 0

    def _look(self) -> dict[str, Any]:
        """The charts, where the log has grown. Raises AdrlError."""
        log = self._folder / METRICS_FILE
        size = log.stat().st_size if log.exists() else 0
        if size == self._size or size == 0:
            return {}
        self._size = size
        source = Source(
            kind="run", name=self._folder.name, facts={}, logs={"run": [log]}, rows=[], evaluations=[]
        )
        self._charts = charts(source)
        return {"charts": self._charts}

    def _next_drive(self) -> None:
        """The newest policy drives as soon as the one before has ended its drive. Raises AdrlError."""
        if self._drive is not None and not (
            self._drive.over and self._drive.choice.policies[0] == self._newest
        ):
            return
        found = newest_policy(self._folder)
        if found is None:
            return
        steps, policy = found
        self._newest = f"{self._folder.name} after {steps:,} steps"
        offer = dataclasses.replace(self._offer, loaded={self._newest: find_policy(policy)})
        if self._drive is None:
            self._drive = Drive(offer, structs.replace(self._choice, policies=(self._newest,)), self._out)
        else:
            choice = self._drive.choice
            self._drive.offer = offer
            self._drive.choose(structs.replace(choice, policies=(self._newest,), task=choice.task + 1))

    def setup(self) -> dict[str, Any]:
        """See Show."""
        about = (
            {"kind": "training", "lanes": [], "world": None} if self._drive is None else self._drive.setup()
        )
        return about | {"title": f"adrl view {self._folder.name}", "charts": self._charts}

    def close(self) -> list[str]:
        """See Show."""
        return [] if self._drive is None else self._drive.close()
