"""Optimal control: costs, backward pass, line search, dynamics of users."""
