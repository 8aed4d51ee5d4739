"""How a simulator steps: which kernels a scene gets, and their launches."""
