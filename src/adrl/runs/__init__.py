"""Training runs: what is asked for (RunConfig), all of it looked up (Run), and the training itself."""

from adrl.runs.config import RunConfig
from adrl.runs.record import versions
from adrl.runs.run import Run
from adrl.runs.train import train

__all__ = ["Run", "RunConfig", "train", "versions"]
