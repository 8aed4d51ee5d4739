"""Which contacts push, stick and slip: rigid contact with Coulomb friction, solved by trying all modes.

One problem serves accelerations and impulses: M x = r + sum J_n' f_n + J_t' f_t with w = J_n x + offset, and
for every row either f_n = 0 <= w, or w = 0 <= f_n with the tangential force in its cone: it sticks
(J_t x + offset = 0), or slips against the force mu f_n.
"""

import itertools
from typing import NamedTuple

import numpy as np

Array = np.ndarray
OFF, STICK, FORWARD, BACKWARD = "off", "stick", "forward", "backward"
SIGN = {FORWARD: 1.0, BACKWARD: -1.0}
TOLERANCE = 1e-8  # violation of a mode that is accepted


class Row(NamedTuple):
    """A contact or limit: rows (nv,) and offsets of its normal and tangential rates.

    tangent None: no friction. slip: sign of a sliding speed that is there already and fixes the force, or 0.
    """

    normal: Array
    normal_offset: float
    tangent: Array | None = None
    tangent_offset: float = 0.0
    friction: float = 0.0
    slip: float = 0.0

    def choices(self) -> tuple[str, ...]:
        """The modes it may be in."""
        if self.tangent is None:
            return OFF, STICK
        if self.slip:
            return OFF, FORWARD if self.slip > 0.0 else BACKWARD
        return OFF, STICK, FORWARD, BACKWARD


class Answer(NamedTuple):
    """Modes of the rows, x (nv,), normal and tangential forces (rows,)."""

    modes: tuple[str, ...]
    x: Array
    normal: Array
    tangential: Array


class ModeError(RuntimeError):
    """No mode satisfies the contact law."""


def solve_mode(mass: Array, force: Array, rows: list[Row], modes: tuple[str, ...]) -> Answer:
    """x and forces with the equations of these modes; inequalities are not looked at."""
    demands, pushes, offsets, owner = [], [], [], []
    for k, (row, mode) in enumerate(zip(rows, modes)):
        if mode == OFF:
            continue
        demands.append(row.normal)
        push = row.normal
        if row.tangent is not None and mode in SIGN:
            push = push - SIGN[mode] * row.friction * row.tangent
        pushes.append(push)
        offsets.append(row.normal_offset)
        owner.append((k, 0))
        if mode == STICK and row.tangent is not None:
            demands.append(row.tangent)
            pushes.append(row.tangent)
            offsets.append(row.tangent_offset)
            owner.append((k, 1))
    nv, forces = len(force), np.zeros((len(rows), 2))
    if not owner:
        return Answer(modes, np.linalg.solve(mass, force), forces[:, 0], forces[:, 1])
    matrix = np.zeros((nv + len(owner), nv + len(owner)))
    matrix[:nv, :nv], matrix[:nv, nv:], matrix[nv:, :nv] = mass, -np.array(pushes).T, demands
    solution = np.linalg.solve(matrix, np.concatenate([force, -np.array(offsets)]))
    for value, place in zip(solution[nv:], owner):
        forces[place] = value
    for k, (row, mode) in enumerate(zip(rows, modes)):
        if mode in SIGN:
            forces[k, 1] = -SIGN[mode] * row.friction * forces[k, 0]
    return Answer(modes, solution[:nv], forces[:, 0], forces[:, 1])


def violation(rows: list[Row], answer: Answer) -> float:
    """By how much the worst inequality of the contact law fails, 0 if none does."""
    worst = 0.0
    for k, (row, mode) in enumerate(zip(rows, answer.modes)):
        if mode == OFF:
            worst = max(worst, -(row.normal @ answer.x + row.normal_offset))
            continue
        worst = max(worst, -answer.normal[k])
        if row.tangent is None or row.slip:
            continue
        if mode == STICK:
            worst = max(worst, abs(answer.tangential[k]) - row.friction * answer.normal[k])
        else:
            worst = max(worst, -SIGN[mode] * (row.tangent @ answer.x + row.tangent_offset))
    return worst


def choose(mass: Array, force: Array, rows: list[Row]) -> list[Answer]:
    """All answers that satisfy the contact law, the best first: one, where friction is not too large.

    Raises:
        ModeError: there is none.
    """
    found: list[tuple[float, Answer]] = []
    for modes in itertools.product(*(row.choices() for row in rows)):
        try:
            answer = solve_mode(mass, force, rows, modes)
        except np.linalg.LinAlgError:  # rows that say the same: another choice has fewer of them
            continue
        found.append((violation(rows, answer), answer))
    found.sort(key=lambda pair: pair[0])
    good = [answer for worst, answer in found if worst <= TOLERANCE]
    if not good:
        raise ModeError(f"no mode of {len(rows)} rows fits; the best fails by {found[0][0]:.2e}")
    return good
