"""What the paper's experiment (section V) is of."""

import numpy as np

import slcp_warp as slcp

SCENE = "flicking_finger"
OBSERVED = slcp.scenes.NAMED[SCENE]().state_index("ellipse.angle")  # whose rate is judged
RANGE = ((-np.pi, 0.0), (-2.0 * np.pi / 3.0, 2.0 * np.pi / 3.0), (0.0, np.pi))  # of Fig. 2 [rad]
