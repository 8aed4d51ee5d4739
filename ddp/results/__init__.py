"""What the solver returns: a result with its trace and status, and what its files must hold."""
