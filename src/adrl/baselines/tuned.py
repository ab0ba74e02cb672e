"""Constants of Stable-Baselines3's algorithms that were tuned here: the best trials of docs/results/tuning.json."""

from typing import Any

TUNED: dict[str, dict[str, Any]] = {
    "TD3": {},
    "SAC": {
        "learning_rate": 2.25e-3,
        "tau": 0.0155,
        "n_steps": 5,
        "ent_coef": "auto_0.01",
        "target_entropy": -1.0,
    },
    "PPO": {
        "learning_rate": 1.86e-3,
        "n_steps": 32,
        "batch_size": 256,
        "n_epochs": 14,
        "gae_lambda": 0.95,
        "clip_range": 0.1,
        "ent_coef": 4.98e-5,
    },
}
"""Algorithm -> arguments of its constructor that differ from what make_model gives."""
