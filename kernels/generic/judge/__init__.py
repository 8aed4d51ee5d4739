"""What an island's solution is measured by, and whether it is one."""
