"""Motion of the bodies of the generic kernels: a tree by its tables, and a step of it without contact."""
