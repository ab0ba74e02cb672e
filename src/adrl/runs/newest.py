"""The policy of a run that is still going on."""

from itertools import pairwise
from pathlib import Path
from typing import Any

from adrl.agents import checkpoint
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.errors import CheckpointError
from adrl.types import ACTION_SIZE


def newest_policy(run: Path) -> tuple[int, MlpPolicy] | None:
    """Environment steps and policy of a run's newest checkpoint; None before the first. Raises CheckpointError."""
    from adrl.agents.actor_policy import policy_of  # JAX, which whoever trains has

    saved = checkpoint.load(run, ("learner",))
    if saved is None:
        return None
    try:
        vector = saved.part("learner")["average_actor"]
        about: dict[str, Any] = saved.state["config"]
        widths = tuple(map(int, about["td3"]["widths"]))
        steps, maturity = int(saved.state["env_steps"]), float(saved.state["learner"]["schedule"][0])
        sizes = (*widths, ACTION_SIZE)
        # What the other layers leave of the vector is the first one's weights.
        later = sum(a * b + b for a, b in pairwise(sizes)) + widths[0]
        config = PolicyConfig(
            input_size=(len(vector) - later) // widths[0],
            widths=widths,
            robot=about["robot"],
            encoder=about["encoder"],
            guidance=about["guidance"],
            method=about["method"],
            maturity=maturity,
            extra={"run": run.name, "environment": about.get("environment") or {}, "env_steps": steps},
        )
        return steps, policy_of(vector, config.sizes, config)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise CheckpointError(
            f"{saved.path}: is not of a run of this version ({error!r}); give another run"
        ) from None
