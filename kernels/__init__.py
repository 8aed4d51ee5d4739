"""Warp code only: what runs per world on the device. Imports nothing but Warp and the standard library."""
