"""A model that Stable-Baselines3, or sb3-contrib, saved: the policy in it, without its algorithm."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.deploy.policy import fingerprint, read_model
from adrl.errors import CheckpointError, MissingExtra


class Sb3Policy:
    """See load_sb3. One with memory forgets when an episode begins."""

    def __init__(self, policy: Any, name: str, fingerprint: str) -> None:
        """policy: of Stable-Baselines3, with Box spaces of (D,) observations and (2,) actions."""
        self.name, self.fingerprint = name, fingerprint
        self._policy = policy
        self._state: Any = None
        self._begins: NDArray[np.bool_] = np.empty(0, dtype=np.bool_)

    def reset(self, rows: NDArray[np.intp]) -> None:
        """Episodes of robots `rows` (M,) begin."""
        if len(rows) and rows.max() < len(self._begins):
            self._begins[rows] = True
        else:
            self._begins = np.empty(0, dtype=np.bool_)

    def act(self, observation: NDArray[np.floating]) -> NDArray[np.float32]:
        """(N, D) observations -> (N, 2) deterministic actions. Raises CheckpointError for another D."""
        expected = self._policy.observation_space.shape
        if observation.shape[1:] != expected:
            raise CheckpointError(
                f"{self.name} takes observations of shape {expected}, and they have {observation.shape[1:]}; train it "
                "with the default encoder, or give an object with the encoder it was trained with: docs/guide/policy.md"
            )
        if len(self._begins) != len(observation):
            self._state, self._begins = None, np.ones(len(observation), dtype=np.bool_)
        actions, self._state = self._policy.predict(
            observation, state=self._state, episode_start=self._begins, deterministic=True
        )
        self._begins = np.zeros(len(observation), dtype=np.bool_)
        return actions


def load_sb3(path: Path) -> Sb3Policy:
    """The policy in a .zip of model.save(). Its reader unpickles: that runs code, so read files that you trust.

    Raises MissingExtra without Stable-Baselines3, CheckpointError for another file, or for other spaces.
    """
    content = read_model(path, "what model.save() of Stable-Baselines3 wrote")
    try:
        from stable_baselines3.common.save_util import load_from_zip_file
    except ImportError:
        raise MissingExtra.named("baselines", "a policy of Stable-Baselines3") from None
    try:
        data, parameters, _ = load_from_zip_file(io.BytesIO(content), device="cpu")
        assert data is not None
        seen, done = data["observation_space"], data["action_space"]
        options = dict(data["policy_kwargs"])
        if data.get("use_sde"):
            options.setdefault("use_sde", True)
        policy = data["policy_class"](seen, done, lambda _: 0.0, **options)
        policy.load_state_dict(parameters["policy"])
    except Exception as error:  # whatever unpickling and PyTorch raise
        reason = " ".join(str(error).split())
        raise CheckpointError(
            f"{path}: not a readable model of Stable-Baselines3 ({type(error).__name__}: {reason[:200]})"
        ) from error
    if not (hasattr(seen, "low") and hasattr(done, "low") and len(seen.shape) == 1 and done.shape == (2,)):
        raise CheckpointError(
            f"{path}: its spaces are {seen} and {done}; ADRL has Box spaces and two actions"
        )
    policy.set_training_mode(False)
    return Sb3Policy(policy, path.name, fingerprint(content))
