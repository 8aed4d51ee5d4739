"""Complementarity problems without a mechanism."""
