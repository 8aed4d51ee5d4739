"""What gives the control inside a rollout."""
