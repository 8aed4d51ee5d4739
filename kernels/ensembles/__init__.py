"""Robustness sweeps: random numbers, draws, and perturbed rollouts."""
