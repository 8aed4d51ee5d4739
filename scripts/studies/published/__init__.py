"""Published problems of optimal control: models, the command, other solvers."""
