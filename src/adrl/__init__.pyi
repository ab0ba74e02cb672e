from adrl.api import RunConfig as RunConfig
from adrl.api import TrainConfig as TrainConfig
from adrl.api import evaluate as evaluate
from adrl.api import evaluate_family as evaluate_family
from adrl.api import load_policy as load_policy
from adrl.api import train as train
from adrl.registration import ENV_ID as ENV_ID

__version__: str
__all__ = [
    "ENV_ID",
    "RunConfig",
    "TrainConfig",
    "__version__",
    "evaluate",
    "evaluate_family",
    "load_policy",
    "train",
]
