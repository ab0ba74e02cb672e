"""What the shared types are made with."""

from typing import Any

from adrl.errors import ConfigError


def require(ok: bool, message: str) -> None:
    """Raises ConfigError."""
    if not ok:
        raise ConfigError(message)


class HasNative:
    """Lays itself out for the core as `native`, on first use; a copy, which cannot have it, does so again."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "native"}
