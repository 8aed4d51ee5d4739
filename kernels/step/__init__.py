"""The specialised step, and rollouts of it."""
