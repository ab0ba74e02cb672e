"""JAX as this package wants it. Every module here imports jax from this one: settings precede its start."""

import ctypes
import importlib.util
import os
from pathlib import Path

from adrl import extras

GPU_PLUGINS = ("jax_cuda12_plugin", "jax_cuda13_plugin", "jax_rocm60_plugin", "jax_rocm7_plugin")

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # malloc.h


def _pin_platform() -> None:
    """CPU unless a GPU plugin is installed or JAX_PLATFORMS says otherwise: a search warns and takes time."""
    if not any(importlib.util.find_spec(name) for name in GPU_PLUGINS):
        os.environ.setdefault("JAX_PLATFORMS", "cpu")


def _keep_freed_memory() -> None:
    """Have the C library keep what XLA frees. By default each update gives its buffers back and faults them in again:
    229 page faults and a fifth of its time at width 128. Where the C library is not glibc, nothing happens."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, 1 << 30)
        mallopt(M_TRIM_THRESHOLD, 2_000_000_000)


extras.require("train", "training")
_pin_platform()
_keep_freed_memory()

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
