"""Questions to a large ensemble: which policy is better, which disturbance matters, where a policy holds."""
