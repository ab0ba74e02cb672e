"""Policies that ADRL is compared with."""
