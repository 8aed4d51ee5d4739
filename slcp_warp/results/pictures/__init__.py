"""Pictures of mechanisms in motion, with matplotlib; `motion` and `kinematics` need NumPy alone."""
