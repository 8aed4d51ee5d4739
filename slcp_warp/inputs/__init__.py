"""Bad input at the door: errors, checks, arrays, limits, and the rules of a mechanism's numbers."""
