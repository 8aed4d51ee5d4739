"""Adjoints of the generic kernels: of a step and a rollout of any scene, by loops over its tables."""
