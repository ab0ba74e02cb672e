"""Constants of Stable-Baselines3's algorithms that were tuned here; docs/tune_baselines.py finds them."""

from typing import Any

TUNED: dict[str, dict[str, Any]] = {"TD3": {}, "SAC": {}, "PPO": {}}
"""Algorithm -> arguments of its constructor that differ from what make_model gives."""
