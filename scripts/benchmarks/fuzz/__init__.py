"""`slcp bench fuzz`: random scenes and states, judged by an oracle that shares no code with the kernels."""
