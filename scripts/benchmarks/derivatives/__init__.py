"""Derivatives of a step against differences, and in single precision."""
