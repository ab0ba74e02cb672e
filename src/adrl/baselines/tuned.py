"""Constants of Stable-Baselines3's algorithms that were tuned here: the best trials of docs/results/tuning.json."""

from typing import Any

TUNED: dict[str, dict[str, Any]] = {
    "TD3": {},
    "SAC": {},
    "PPO": {
        "learning_rate": 3e-4,
        "n_steps": 32,
        "batch_size": 256,
        "n_epochs": 10,
        "gae_lambda": 0.95,
        "clip_range": 0.2,
        "ent_coef": 1e-5,
    },
}
"""Algorithm -> arguments of its constructor that differ from what make_model gives."""
