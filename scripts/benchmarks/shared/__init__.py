"""What the benchmarks share: timing, workloads, a mechanism in plain NumPy."""
