"""The name of before for adrl.deploy.localisation, which is where this lives."""

from adrl.deploy.localisation import Localisation

__all__ = ["Localisation"]
