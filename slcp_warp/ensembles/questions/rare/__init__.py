"""Rare failures of a policy, and the smallest disturbance that makes it fail."""
