"""Costs as sums of terms, each of one state or one control by its name."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slcp_warp.kernels.control.cost_terms import FIELDS, KINDS, make_terms

from ..description.names import index_of
from ..description.scene import Scene
from ..inputs.checks import choice, instance, number, shown
from ..inputs.errors import ArgumentError
from .cost import Cost

EVERY = "all"
WIDTH = 0.1
NAMING = [0, 1, 5]  # of a term's fields: its kind, its component, the state that is taken off it


@dataclass(frozen=True)
class Term:
    """One term of a cost, of one component s; with e = s - target it is `weight` times

    e ("linear"), e^2 ("square"), 1 - cos e ("cosine"), sqrt(e^2 + width^2) - width ("absolute"), max(e, 0)^2
    ("above") or min(e, 0)^2 ("below").

    Attributes:
        kind: one of the above.
        weight: per step, or of the final state.
        state: a component of the state, by its name (`Scene.state_names`) or its place.
        control: a control, by its name or its place, or "all"; either a state or a control.
        target: [unit of the component].
        minus: a state that is taken off `state`, by its name or its place: the term is of their difference.
        width: > 0, where "absolute" turns from a parabola into a line [unit of the component].
    """

    kind: str
    weight: float
    state: str | int | None = None
    control: str | int | None = None
    target: float = 0.0
    width: float = WIDTH
    minus: str | int | None = None

    def __post_init__(self) -> None:
        choice("Term.kind", self.kind, KINDS)
        for name in ("weight", "target"):
            object.__setattr__(self, name, number(f"Term.{name}", getattr(self, name)))
        object.__setattr__(self, "width", number("Term.width", self.width, 0.0, above=True))
        if (self.state is None) == (self.control is None):
            raise ArgumentError(
                f"Term.state is {shown(self.state)} and Term.control {shown(self.control)}; "
                "one of them is needed"
            )
        if self.minus is not None and self.state is None:
            raise ArgumentError(f"Term.minus is {shown(self.minus)} without a state that it is taken off")


# of a task that is not planned: the sum of no terms
NO_COST = Cost(make_terms, [0.0], fixed=[1.0], steady=True)


def effort(weight: float) -> Term:
    """weight |u|^2."""
    return Term("square", weight, control=EVERY)


def terms(scene: Scene, running: Sequence[Term], final: Sequence[Term] = ()) -> Cost:
    """The sum of the running terms over all steps and of the final terms at the last state.

    Args:
        scene: whose states and controls the terms name.
        running: of x_k and u_k, k = 0 .. N - 1.
        final: of x_N, of states only.

    Raises:
        ArgumentError: a name that the scene has not got, or a final term of a control.
    """
    instance("scene", scene, Scene, "a slcp_warp.Scene")
    return sum_of(scene.state_names, scene.control_names, running, final)


def sum_of(
    states: Sequence[str], controls: Sequence[str], running: Sequence[Term], final: Sequence[Term] = ()
) -> Cost:
    """`terms` for states and controls of these names."""
    rows: list[tuple[float, ...]] = []
    counts = []
    for name, group in (("running", running), ("final", final)):
        if not isinstance(group, list | tuple) or not all(isinstance(each, Term) for each in group):
            raise ArgumentError(f"{name} is {shown(group)}; a list of costs.Term is needed")
        before = len(rows)
        for i, each in enumerate(group):
            label = f"{name}[{i}]"
            if name == "final" and each.control is not None:
                raise ArgumentError(
                    f"{label}.control is {shown(each.control)}; no control follows the last state"
                )
            less = -1 if each.minus is None else index_of(f"{label}.minus", each.minus, states)
            rows += [(KINDS.index(each.kind), place, each.weight, each.target, each.width, less)
                     for place in _places(label, each, states, controls)]  # fmt: skip
        counts.append(len(rows) - before)
    if not rows:
        every = "" if controls or not (running or final) else " but of controls, of which there are none"
        raise ArgumentError(f"running and final hold no term{every}; at least one is needed")
    weights = np.concatenate([[counts[0]], np.array(rows, float).reshape(-1)])
    assert weights.size == 1 + FIELDS * sum(counts)
    places = np.zeros((len(rows), FIELDS))
    places[:, NAMING] = 1.0
    fixed = np.concatenate([[1.0], places.reshape(-1)])
    return Cost(make_terms, weights, nx=len(states), nu=len(controls), fixed=fixed, steady=True)


def _places(label: str, term: Term, states: Sequence[str], controls: Sequence[str]) -> list[int]:
    """Where a term's components are among states and then controls."""
    if term.control is None:
        return [index_of(f"{label}.state", term.state, states)]  # type: ignore[arg-type]
    nx = len(states)
    if term.control == EVERY:
        return [nx + i for i in range(len(controls))]
    return [nx + index_of(f"{label}.control", term.control, controls)]
