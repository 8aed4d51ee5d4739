"""Complementarity problems and residuals without a mechanism."""
