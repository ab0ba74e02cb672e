"""Methods against each other: every method with every seed, each final policy on the same test tasks."""
