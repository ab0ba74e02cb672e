"""The jobs of a comparison on a Ray cluster: the same worker, on whatever machine has a CPU free.

No disk is shared: a job's settings go out with it, its small result files come back as bytes, and the driver writes
them. Every machine of the cluster needs this version of ADRL, and the files that the options name.
"""

import contextlib
import fcntl
import logging
import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import IO, Any

from adrl import files, processes
from adrl.comparison.config import CompareConfig, from_document
from adrl.comparison.jobs import RESULT_FILE, Job, is_finished
from adrl.comparison.pool import WORKER, cache_environment, log_path, task_line
from adrl.errors import ConfigError

POLL_S = 0.5
CONNECT_S = 10.0
LOCKS_FOLDER = "adrl-cores"


def run_on_ray(config: CompareConfig, jobs: Sequence[Job], tell: Callable[[int, int], None]) -> list[Job]:
    """As adrl.comparison.pool.run_all, on the cluster at config.ray. Raises ConfigError where there is none."""
    import ray

    if not jobs:
        return []
    _require_listening(str(config.ray))
    try:
        ray.init(address=config.ray, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise ConfigError(f"no Ray cluster at {config.ray} ({error}); see ray status there") from None
    try:
        return _run(config, jobs, tell)
    finally:
        ray.shutdown()  # cancels what still runs: the job belongs to this driver


def _require_listening(address: str) -> None:
    """Ray itself would try for minutes. Raises ConfigError."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=CONNECT_S).close()
    except (OSError, ValueError, OverflowError) as error:
        raise ConfigError(
            f"no Ray cluster at {address} ({error}); give HOST:PORT of one that ray start --head started, or "
            "leave out --ray"
        ) from None


def _run(config: CompareConfig, jobs: Sequence[Job], tell: Callable[[int, int], None]) -> list[Job]:
    import ray
    from ray.exceptions import RayError

    # A job is minutes of work: a machine that was lost gets it once more, a job that failed does not.
    remote: Any = ray.remote(num_cpus=1, max_retries=1)(remote_job)
    document, version = config.document(), metadata.version("adrl")
    # One after the other in the order of the jobs, so that a cluster that is stopped has whole seeds.
    pending = {remote.remote(document, job.method, job.seed, version): job for job in jobs}
    failed, ended = [], 0
    while pending:
        cpus = int(ray.cluster_resources().get("CPU", 0))
        tell(ended, min(cpus, len(pending)))
        ready, _ = ray.wait(list(pending), timeout=POLL_S)
        for reference in ready:
            job = pending.pop(reference)
            ended += 1
            try:
                _write(config, job, *ray.get(reference))
            except RayError as error:
                files.atomic_write_text(log_path(config, job), f"{error}\n")
            if not is_finished(config, job):
                failed.append(job)
    tell(ended, 0)
    return failed


def _write(config: CompareConfig, job: Job, log: bytes, results: dict[str, bytes]) -> None:
    """The result's files, the summary last: it says that the others are there."""
    files.atomic_write_bytes(log_path(config, job), log)
    for name in sorted(results, key=lambda name: name == RESULT_FILE):
        path = config.out / job.name / name
        path.parent.mkdir(parents=True, exist_ok=True)
        files.atomic_write_bytes(path, results[name])


def remote_job(
    document: dict[str, Any], method: str, seed: int | None, version: str
) -> tuple[bytes, dict[str, bytes]]:
    """What runs on the cluster: a worker on a core of its own. Its log, and its result's files, none if it failed."""
    here = metadata.version("adrl")
    if here != version:
        return f"adrl: error: the driver has ADRL {version}, this machine {here}; install one\n".encode(), {}
    job = Job(method, seed)
    with tempfile.TemporaryDirectory(prefix="adrl-") as folder, free_core() as core:
        config = replace(from_document(document), out=Path(folder))
        log = log_path(config, job)
        log.parent.mkdir(parents=True)
        with open(log, "wb") as stream:
            process = processes.start_module(
                WORKER,
                stdout=stream,
                stderr=subprocess.STDOUT,
                environment=cache_environment(config, job),
            )
        try:
            processes.send(process, task_line(config, job, core))
            process.wait()
        finally:
            processes.close(process)
        results = {}
        if process.returncode == 0 and is_finished(config, job):
            result = config.out / job.name
            paths = [path for path in result.rglob("*") if path.is_file()]
            results = {path.relative_to(result).as_posix(): path.read_bytes() for path in paths}
        return log.read_bytes(), results


@contextlib.contextmanager
def free_core() -> Iterator[int]:
    """A core that no other job of this machine has, for as long as the context lasts; waits for one.

    Ray counts CPUs and names none. The lock is the kernel's: it goes with its process.
    """
    folder = Path(tempfile.gettempdir()) / f"{LOCKS_FOLDER}-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    while True:
        for core in processes.usable_cores():
            with open(folder / str(core), "wb") as stream:
                if _locked(stream):
                    yield core
                    return
        time.sleep(POLL_S)


def _locked(stream: IO[bytes]) -> bool:
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
