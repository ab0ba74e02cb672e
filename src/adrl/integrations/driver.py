"""The name of before for adrl.deploy.driver, which is where this lives."""

from adrl.deploy.driver import Driver, Report

__all__ = ["Driver", "Report"]
