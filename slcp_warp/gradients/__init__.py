"""Derivatives of rollouts, recorded and launched."""
