"""Pictures, from saved files only."""
