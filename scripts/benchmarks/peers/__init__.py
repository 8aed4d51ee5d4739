"""Other simulators on the same problems."""
