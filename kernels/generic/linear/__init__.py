"""Matrices of blocks: assembled, factored, solved."""
