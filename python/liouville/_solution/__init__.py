"""Solutions of runs: what they hold, their parts, and their files."""
