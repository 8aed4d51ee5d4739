"""Charts of the studies of speed against accuracy."""
