"""Backward passes of DDP, and the quadratic program of one step."""
