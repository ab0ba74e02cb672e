"""JAX as this package wants it. Every module here imports jax from this one: settings precede its start."""

import importlib.util
import os
from pathlib import Path

GPU_PLUGINS = ("jax_cuda12_plugin", "jax_cuda13_plugin", "jax_rocm60_plugin", "jax_rocm7_plugin")


def _pin_platform() -> None:
    """CPU unless a GPU plugin is installed or JAX_PLATFORMS says otherwise: a search warns and takes time."""
    if not any(importlib.util.find_spec(name) for name in GPU_PLUGINS):
        os.environ.setdefault("JAX_PLATFORMS", "cpu")


_pin_platform()

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402

__all__ = ["jax", "jnp"]


def cache_folder() -> Path:
    """Where compiled programs are kept between runs: $XDG_CACHE_HOME/adrl/jax, else ~/.cache/adrl/jax."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(base) / "adrl" / "jax"


if getattr(jax.config, "jax_compilation_cache_dir", None) is None:
    jax.config.update("jax_compilation_cache_dir", str(cache_folder()))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
