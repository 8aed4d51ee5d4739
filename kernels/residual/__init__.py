"""One complementarity condition: smoothing, noise, and the residuals of the paper."""
