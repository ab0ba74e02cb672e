"""The given worlds that a policy has learned from, from its config.json."""

from adrl.deploy.policy import PolicyConfig
from adrl.errors import CheckpointError
from adrl.worlds.given import GIVEN


def training_worlds(config: PolicyConfig) -> set[str] | None:
    """Fingerprints of the given worlds that a policy was trained in, its demonstrations' and those of the policy it
    began with included; None where its run does not say.

    Raises CheckpointError for a list that is none.
    """
    environment, settings = config.table("environment"), config.table("settings")
    if "worlds" not in environment:
        # A run writes no entry where it has nothing to say, and runs of before never did.
        scenario = str(config.extra.get("scenario", GIVEN[0]))
        drawn = not scenario.startswith(GIVEN)
        return set() if drawn and not environment.get("fine_tune") and not settings.get("dataset") else None
    worlds = environment["worlds"]
    if worlds is None or (isinstance(worlds, list) and all(isinstance(world, str) for world in worlds)):
        return None if worlds is None else set(worlds)
    raise CheckpointError(
        f"environment.worlds in config.json is {worlds!r}, no list of names; restore the file"
    )
