"""What gives the control inside a rollout: one contract, a file for each kind."""
