"""Where plans start from: sampling, noise, both."""
