"""Running a trained policy: numpy only."""
