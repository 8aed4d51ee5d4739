"""Model predictive control: a plan made again from every state that is met (paper, IV.C)."""
