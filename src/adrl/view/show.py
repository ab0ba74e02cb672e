"""What a page can show, as the server takes it."""

from typing import Any, Protocol

from adrl.view.messages import Message


class Show(Protocol):
    """Something to watch. The server makes one call at a time."""

    version: int
    """Counts up when pages are to be told all anew."""

    def setup(self) -> dict[str, Any]:
        """All that a page needs to begin; JSON."""
        ...

    def turn(self, asked: list[Message], now_s: float) -> dict[str, Any]:
        """Do what pages ask for, go on to this time of the wall's clock, and tell what is new; JSON. What cannot be
        done is told as `errors`."""
        ...

    def close(self) -> list[str]:
        """The end. Paths that have been written."""
        ...
