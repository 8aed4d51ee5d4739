"""Pictures of mechanisms in motion, with matplotlib;
`motion`, `kinematics` and `mechanism` need NumPy alone.
"""
