"""The mechanism between contacts: kinematics, inertia, forces, and where it would go without contact."""
