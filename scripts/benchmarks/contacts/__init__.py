"""Cost of steps with many contacts, beside MuJoCo."""
