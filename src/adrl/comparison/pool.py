"""Jobs side by side, each in a process of its own that is bound to a core of its own."""

import json
import shutil
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from adrl import processes
from adrl.comparison.config import CompareConfig
from adrl.comparison.jobs import Job, is_finished

WORKER = "adrl.comparison.worker"
LOGS_FOLDER = "logs"
CACHE_FOLDER = "cache"
POLL_S = 0.2
CHECKPOINT_S = 30.0
"""A worker that is stopped may take so long to write its checkpoint."""


def log_path(config: CompareConfig, job: Job) -> Path:
    """What the job's process printed."""
    return config.out / LOGS_FOLDER / f"{job.name}.log"


def cache_path(config: CompareConfig, job: Job) -> Path:
    """Where JAX keeps compiled programs: in a folder of the job's own, gone when it ends, so that each job pays for its
    compilation; with shares_compiled in one for all, gone at the end.
    """
    folder = config.out / CACHE_FOLDER
    return folder if config.shares_compiled else folder / job.name


def cores(config: CompareConfig) -> list[int]:
    """The cores to work on: as many as workers were asked for, at most the usable ones."""
    usable = processes.usable_cores()
    return usable[: config.workers or len(usable)]


def run_all(config: CompareConfig, jobs: Sequence[Job], tell: Callable[[int, int], None]) -> list[Job]:
    """Run the jobs in their order; returns those that failed. tell(ended, running) hears of the progress.

    No process survives this function, nor this process.
    """
    # Of a comparison that was killed.
    shutil.rmtree(config.out / CACHE_FOLDER, ignore_errors=True)
    waiting, failed, ended = list(jobs), [], 0
    free, running = cores(config), dict[int, tuple[Job, processes.Process]]()
    try:
        while waiting or running:
            while waiting and free:
                core, job = free.pop(0), waiting.pop(0)
                running[core] = job, _start(config, job, core)
            tell(ended, len(running))
            time.sleep(POLL_S)
            for core, (job, process) in list(running.items()):
                if process.poll() is None:
                    continue
                processes.close(process)
                if not config.shares_compiled:
                    shutil.rmtree(cache_path(config, job), ignore_errors=True)
                del running[core]
                free.append(core)
                ended += 1
                if process.returncode != 0 or not is_finished(config, job):
                    failed.append(job)
        tell(ended, 0)
    finally:
        processes.end([process for _, process in running.values()], CHECKPOINT_S)
        shutil.rmtree(config.out / CACHE_FOLDER, ignore_errors=True)
    return failed


def cache_environment(config: CompareConfig, job: Job) -> dict[str, str]:
    """Has JAX keep compiled programs in cache_path; where others read them, those that compile quickly, too."""
    folder = {"JAX_COMPILATION_CACHE_DIR": str(cache_path(config, job).absolute())}
    return folder | ({"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2"} if config.shares_compiled else {})


def _start(config: CompareConfig, job: Job, core: int) -> processes.Process:
    """A worker with its job on standard input, which stays open: see adrl.comparison.worker."""
    path = log_path(config, job)
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "wb") as log:
        process = processes.start_module(
            WORKER,
            stdout=log,
            stderr=subprocess.STDOUT,
            environment=cache_environment(config, job),
        )
    processes.send(process, task_line(config, job, core))
    return process


def task_line(config: CompareConfig, job: Job, core: int) -> bytes:
    """What the worker reads from its standard input."""
    task = {"core": core, "method": job.method, "seed": job.seed, "config": config.document()}
    return json.dumps(task).encode()
