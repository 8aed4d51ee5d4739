"""Differential dynamic programming in batches, receding horizon, trajectory libraries and policies."""
