"""The ADRL learner: TD3 with value-driven imitation and rewards formed at sampling time. Imports JAX."""
