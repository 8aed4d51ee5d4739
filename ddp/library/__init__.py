"""Libraries of local feedback controllers: receding horizon, refinement, files."""
