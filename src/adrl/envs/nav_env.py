"""Gymnasium environment of one robot."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from adrl.envs.render import Renderer, has_window
from adrl.envs.vector_env import RENDER_FPS, RESULTS, NavVectorEnv, require_known_options
from adrl.errors import MissingExtra, UnknownName

F32 = NDArray[np.float32]


class NavEnv(gymnasium.Env[F32, F32]):
    """A vector environment of one robot, without its leading axis. Takes NavVectorEnv's keyword arguments."""

    # Gymnasium declares metadata per instance, and reads it from the class.
    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["human", "rgb_array"] if has_window() else ["rgb_array"],
        "render_fps": RENDER_FPS,
    }

    def __init__(self, render_mode: str | None = None, *, seed: int | None = None, **kwargs: Any) -> None:
        modes = self.metadata["render_modes"]
        if render_mode == "human" and "human" not in modes:
            raise MissingExtra.named("render", "render_mode 'human'")
        if render_mode not in (None, *modes):
            raise UnknownName("render_mode", str(render_mode), modes)
        self._env = NavVectorEnv(1, autoreset_mode=AutoresetMode.DISABLED, **kwargs)
        self.observation_space = self._env.single_observation_space
        self.action_space = self._env.single_action_space
        self.render_mode = render_mode
        self._renderer = Renderer() if render_mode is not None else None
        super().reset(seed=seed)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[F32, dict[str, Any]]:
        """Start a new episode. Returns the (D,) observation, and info with a step's entries, all zero.

        There are no options: raises ConfigError for any.
        """
        require_known_options(options or {}, ())
        super().reset(seed=seed)
        self._env.np_random = (self.np_random,)
        observation, info = self._env.reset()
        self._show()
        return observation[0], _own(info)

    def step(self, action: F32) -> tuple[F32, float, bool, bool, dict[str, Any]]:
        """Execute the (2,) action for one control period."""
        observation, rewards, terminated, truncated, info = self._env.step(np.asarray(action)[None])
        self._show()
        return observation[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), _own(info)

    def expert_action(self) -> F32:
        """(2,) action of A* and the expert, which know everything, in the current state."""
        return self._env.expert_actions()[0]

    def render(self) -> NDArray[np.uint8] | None:
        """The (H, W, 3) picture in render mode rgb_array; the window of mode human updates itself."""
        if self.render_mode == "rgb_array" and self._renderer is not None:
            return self._renderer.draw(self._env.sim, 0)
        return None

    def close(self) -> None:
        """Close the window, if any."""
        if self._renderer is not None:
            self._renderer.close()

    def _show(self) -> None:
        if self.render_mode == "human" and self._renderer is not None:
            self._renderer.show(self._env.sim, 0, RENDER_FPS)


def _own(info: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """The only row's results: arrays, and plain booleans, which is what others' callbacks and loggers take."""
    values = {name: info[name][0] for name in RESULTS}
    return {name: bool(value) if value.ndim == 0 else value for name, value in values.items()}
