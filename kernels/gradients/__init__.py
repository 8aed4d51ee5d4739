"""Adjoints of rollouts, and gradients by every column of the parameter table."""
