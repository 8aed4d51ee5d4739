"""What acts in a MuJoCo model and has no counterpart here: refused by name, for `reader.py`.

A field that a version of MuJoCo lacks says nothing: that version has not got what it stands for.
"""

from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from .motors import FORCERANGE
from .names import named
from .plane import MjcfError

FLAGS = ("LIMIT", "SPRING", "DAMPER", "ACTUATION")
TENDONS, FRICTIONLOSS = "tendons", "frictionloss"
EQUALITIES = "equality constraints"
COUNTS = {"nflex": "flexes", "nplugin": "plugins"}
MEDIUM = ("density", "viscosity")  # of what bodies move in: drag
# fields that are zero where nothing of the kind acts, by the element that they belong to
FIELDS = {
    "joint": {
        "dof_frictionloss": FRICTIONLOSS, "dof_dampingpoly": "nonlinear damping",
        "jnt_stiffnesspoly": "nonlinear stiffness", "jnt_springyield": "a spring that yields",
        "jnt_actfrclimited": "actuatorfrcrange",
    },
    "tendon": {
        "tendon_limited": "range", "tendon_frictionloss": FRICTIONLOSS, "tendon_armature": "armature",
        "tendon_actfrclimited": "actuatorfrcrange", "tendon_dampingpoly": "nonlinear damping",
        "tendon_stiffnesspoly": "nonlinear stiffness", "tendon_springyield": "a spring that yields",
    },
    "body": {"body_gravcomp": "gravcomp"},
    "actuator": {
        "actuator_forcelimited": FORCERANGE, "actuator_dampingpoly": "nonlinear damping",
        "actuator_delay": "delay",
    },
}  # fmt: skip


WORDS = (
    *COUNTS.values(),
    EQUALITIES,
    TENDONS,
    *MEDIUM,
    *dict.fromkeys(w for fields in FIELDS.values() for w in fields.values()),
)
HINT = " (load_mjcf can leave it out: left_out)"
BUT = {
    "dof_frictionloss": " but as a brake, brakes=True",
    "actuator_forcelimited": " but where it is alike to both sides",
}


def refuse_what_is_missing(
    m: Any, left_out: Collection[str] = (), made: Callable[[str, int], bool] = lambda field, i: False
) -> None:
    """Raise MjcfError for the first thing that would act in MuJoCo and not here.

    Args:
        left_out: words of `WORDS`, of what may act there alone.
        made: (field, place) -> whether that is made of something here.
    """
    _refuse_options(m, left_out)
    for count, what in COUNTS.items():
        if getattr(m, count, 0) and what not in left_out:
            raise MjcfError(f"the model has {getattr(m, count)} {what}; they are not supported{HINT}")
    for kind, fields in FIELDS.items():
        if kind == "tendon" and TENDONS in left_out:
            continue
        for field, what in fields.items():
            values = np.asarray(getattr(m, field, ()) if what not in left_out else ())
            for place in (i for i, value in enumerate(values) if np.any(value) and not made(field, i)):
                owner = m.dof_jntid[place] if field.startswith("dof_") else place
                name = named(m, kind, int(owner))
                value = np.round(values[place].astype(float), 9).tolist()
                of = "is limited" if values.dtype == bool else f"is {value}"
                but = BUT.get(field, "")
                raise MjcfError(f"{kind} {name!r}: {what} {of}; it is not supported{but}{HINT}")


def is_disabled(m: Any, flag: str) -> bool:
    """Whether a flag of the options is off."""
    import mujoco

    return bool(m.opt.disableflags & int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}", 0)))


def _refuse_options(m: Any, left_out: Collection[str]) -> None:
    import mujoco

    if not 0.0 < m.opt.timestep < np.inf:
        raise MjcfError(f"option timestep is {float(m.opt.timestep):g}; a positive number is needed")
    for flag in (*FLAGS, *(("CONSTRAINT",) if m.jnt_limited.any() else ())):
        if is_disabled(m, flag):
            raise MjcfError(f"flag {flag.lower()} is disabled; leave out of the model what is not to act")
    if m.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        raise MjcfError("flag override is enabled; give the geoms the friction that they are to have")
    for name in MEDIUM:
        value = float(getattr(m.opt, name))
        if value != 0.0 and name not in left_out:
            raise MjcfError(f"option {name} is {value:g}; there is no drag of a medium{HINT}")
    for i in range(m.nu):
        if 0 <= (group := int(m.actuator_group[i])) < 31 and m.opt.disableactuator >> group & 1:
            raise MjcfError(
                f"actuator {named(m, 'actuator', i)!r}: its group {group} is disabled; leave it out of the "
                "model"
            )
