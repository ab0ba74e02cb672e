"""How good a policy is: rollouts on fixed tasks, metrics, intervals and result files."""
