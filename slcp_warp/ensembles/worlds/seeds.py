"""Seeds of worlds in which something is chosen, which no sweep of the given seed has."""

import numpy as np


def seed_apart(seed: int, use: int) -> int:
    """A seed for one use of a given seed, which neither other uses nor the seed itself have."""
    return int(np.random.SeedSequence((seed, use)).generate_state(1)[0] % 2**31)
