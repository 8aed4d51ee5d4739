"""Numbers of a mechanism from recorded runs."""
