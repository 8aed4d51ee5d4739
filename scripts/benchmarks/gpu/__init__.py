"""What a GPU makes of the kernels: right, and how fast; `slcp gpu-check`."""
