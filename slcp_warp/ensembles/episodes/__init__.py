"""A task as an environment of reinforcement learning: worlds that are stepped by whoever learns."""

from .environment import Environment, Moment

__all__ = ["Environment", "Moment"]
