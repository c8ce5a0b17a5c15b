"""What is known of runs: how they were configured, what was recorded, and the figures that follow."""
