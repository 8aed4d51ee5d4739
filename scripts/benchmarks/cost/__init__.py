"""What steps, Jacobians, gradients and kernels cost."""
