"""The best validated policy of a run that was given one to begin with: it never ends below its beginning."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from numpy.typing import NDArray

from adrl.agents.interface import Validation
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.errors import CheckpointError


class Score(NamedTuple):
    """How a policy did on the validation tasks, which are the same for all policies of a run."""

    env_steps: int
    """Environment steps of the run when the policy was like this; 0 for the one it began with."""
    success: float
    seconds: float
    """Mean time of a task; one that was not solved counts with its time limit."""

    def beats(self, other: "Score") -> bool:
        """More tasks solved, or as many in less time."""
        return (self.success, -self.seconds) > (other.success, -other.seconds)


@dataclass
class Best:
    """The policy that a run began with, or a later one that did better."""

    start: Score
    kept: Score
    policy: MlpPolicy

    @classmethod
    def of(cls, start: MlpPolicy, validation: Validation) -> "Best":
        """Before the first step."""
        score = Score(0, validation.success, validation.seconds)
        return cls(score, score, start)

    def offer(self, policy: MlpPolicy, env_steps: int, validation: Validation) -> None:
        """Keep this policy instead if it is better."""
        score = Score(env_steps, validation.success, validation.seconds)
        if score.beats(self.kept):
            self.kept, self.policy = score, policy

    def policy_with(self, about: PolicyConfig) -> MlpPolicy:
        """The policy, as one of this run."""
        scores = {"start": self.start._asdict(), "kept": self.kept._asdict()}
        extra = dict(about.extra) | {"validated": scores}
        return MlpPolicy(
            self.policy.layers, replace(about, maturity=self.policy.config.maturity, extra=extra)
        )

    def numbers(self) -> dict[str, Any]:
        """All but the layers, for JSON."""
        return {
            "start": list(self.start),
            "kept": list(self.kept),
            "maturity": self.policy.config.maturity,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The layers."""
        return {
            f"layers.{i}.{name}": array
            for i, layer in enumerate(self.policy.layers)
            for name, array in zip(("weight", "bias"), layer, strict=True)
        }

    @classmethod
    def restored(
        cls, numbers: Mapping[str, Any] | None, arrays: Mapping[str, NDArray[Any]], about: PolicyConfig
    ) -> "Best":
        """From numbers() and arrays(). Raises CheckpointError where there are none."""
        if numbers is None:
            raise CheckpointError("the checkpoint has no best policy; it is of a run that keeps none")
        layers = [
            (arrays[f"layers.{i}.weight"], arrays[f"layers.{i}.bias"]) for i in range(len(about.widths) + 1)
        ]
        policy = MlpPolicy(layers, replace(about, maturity=numbers["maturity"]))
        return cls(Score(*numbers["start"]), Score(*numbers["kept"]), policy)
