"""The stability battery: where each method holds, degrades, or fails."""
