"""Slopes that come back from later steps as next to nothing, or nothing: these steps are left out.

What a contact holds loses most of its digits at every step that is gone through, 1e-12 a step and faster, and
below the smallest numbers of a precision no answer is right in any relative sense. A step that nothing is
asked of needs no derivative either, so that one without does no harm.
"""

import warp as wp

FADED = {wp.float64: 1e-150, wp.float32: 1e-25}  # of the largest that came
