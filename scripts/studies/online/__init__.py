"""Model predictive control beside libraries: what a cycle costs and is worth, and every named task."""
