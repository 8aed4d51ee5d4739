"""The generic kernels: any scene by tables, a world's state in a workspace."""
