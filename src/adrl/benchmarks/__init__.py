"""Benchmarks: how fast the simulator, the planners and the learner are on this machine."""
