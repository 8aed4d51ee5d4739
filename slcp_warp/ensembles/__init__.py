"""Many worlds: robustness sweeps, their reports and statistics, and particles."""
