"""Steps and rollouts recorded on a `wp.Tape` where an input requires a gradient."""

from ..gradients import tape
from .arrays import Controls, RolloutArrays, StepArrays


def record_step(kernels: tape.Differentiable, a: StepArrays) -> None:
    """Record a step that was made."""
    blocked = (("impulse", a.impulse), ("gap", a.gap))
    tape.record_step(
        tape.Recorded(kernels, a.table, a.x, a.u, a.external, a.state, a.status, blocked=blocked)
    )


def record_rollout(
    kernels: tape.Differentiable, a: RolloutArrays, controls: Controls, record: tuple[str, ...]
) -> None:
    """Record a rollout that was made, under given controls or a tracking policy.

    Args:
        kernels, a: that made it, and what they filled.
        controls: where its controls came from.
        record: names of the outputs that the caller gets.
    """
    applied, policy = (controls.us, None) if controls.us is not None else (a.controls, controls.struct)
    shown = a.controls if "controls" in record and kernels.spec.structure.nu else None
    blocked = tuple((name, getattr(a, name)) for name in ("impulse", "gap") if name in record)
    run = tape.Recorded(
        kernels, a.table, a.x0, applied, a.external, a.states, a.status, policy, shown, blocked
    )
    tape.record_rollout(run)
