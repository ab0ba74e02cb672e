"""The two forms of the paper's equations."""

from typing import Literal, get_args

from adrl.types.base import require

Form = Literal["literal", "corrected"]
"""How an equation of the paper is computed: as printed, or as docs/fidelity.md says it has to be read."""
FORMS: tuple[Form, ...] = get_args(Form)


def require_forms(owner: object, *equations: str) -> None:
    """Each named field of a config is a Form. Raises ConfigError."""
    for equation in equations:
        value = getattr(owner, equation)
        require(value in FORMS, f"{type(owner).__name__}.{equation} is {value!r}; give literal or corrected")
