"""Derivatives of the generic step: what of them is loops over tables."""
