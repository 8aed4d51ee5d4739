"""Sweeps of tasks that are kept on disk: what decides their table, how they travel, how they are cut."""
