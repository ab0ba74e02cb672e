"""One job in a process of its own, on a core of its own: python -m adrl.comparison.worker, the job on standard input.

The parent keeps that pipe open for as long as it lives. When it closes the worker leaves: a comparison that was killed
leaves no process behind that writes to its folder.
"""

import json
import os
import sys
import threading
import time
from typing import Any

from adrl.processes import bind_to_core

STARTED_S = time.monotonic()


def main() -> int:
    """Run the job. Exit codes as those of adrl."""
    with open(0, "rb", buffering=0, closefd=False) as stream:
        job: dict[str, Any] = json.loads(stream.readline())
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    bind_to_core(job["core"])
    from adrl.comparison.config import from_document
    from adrl.comparison.jobs import Job, run_job
    from adrl.errors import AdrlError

    try:
        run_job(from_document(job["config"]), Job(job["method"], job["seed"]), STARTED_S)
    except AdrlError as error:
        print(f"adrl: error: {error}", file=sys.stderr)  # noqa: T201
        return 2
    except KeyboardInterrupt as stop:
        print(f"adrl: {stop}", file=sys.stderr)  # noqa: T201
        return 1
    return 0


def _leave_with_parent() -> None:
    os.read(0, 1)
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
