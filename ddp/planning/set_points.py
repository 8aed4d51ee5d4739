"""Controls that are set-points, and those that hold a state's place: what a plan of servos begins from."""

from typing import Any

import numpy as np

from slcp_warp import Scene

SAME = 1e-9  # of a stiffness, as one


def set_points(scene: Any, x0: np.ndarray) -> np.ndarray:
    """(nu,) of every servo the place of x0, by which its spring pulls nothing; 0 of other controls.

    A servo is an actuator whose gear is the stiffness of the spring of what it drives, a joint's
    (`slcp.servo`) or a tendon's (`slcp.limited_servo`): its control is where the spring rests.
    """
    if not isinstance(scene, Scene):
        return np.zeros(0)
    s, numbers = scene.structure, scene.default_parameters()
    out = np.zeros(s.nu)
    for a, dof in enumerate(s.actuators):
        gear = numbers["gear"][a]
        if dof < 0:
            i = s.driven_tendon(a)
            start, stiffness = s.tendon_start(i), numbers["tendon_stiffness"][i]
            shares = numbers["tendon_coefficient"][start : start + len(s.tendons[i])]
            place = shares @ x0[list(s.tendons[i])] - numbers["tendon_length"][i]
        elif s.sprung:
            stiffness, place = numbers["stiffness"][dof], x0[dof] - numbers["rest"][dof]
        else:
            continue
        if stiffness > 0.0 and abs(gear - stiffness) <= SAME * stiffness:
            out[a] = place
    return out
