"""Making, loading and launching kernels, whatever they compute."""
