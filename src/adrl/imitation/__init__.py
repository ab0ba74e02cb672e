"""Imitation: demonstrations, the probe and the schedule that releases the expert."""
