"""Benchmarks: cost, accuracy, stability, peers, and random scenes."""
