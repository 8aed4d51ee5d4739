"""A scene in plain NumPy, apart from the kernels: motion, contact, and what holds at the end of a step."""
