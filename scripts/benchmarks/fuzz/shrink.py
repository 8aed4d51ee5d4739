"""Making a failing case small: parts are dropped and numbers made plain while it goes on failing alike."""

from collections.abc import Callable

from .case import Case
from .simpler import SIMPLER
from .verdicts import SILENT, WRONG

ROUNDS = 6


def kind_of(case: Case) -> tuple[str, str]:
    """Verdict and the words of its reason, without numbers."""
    verdict, reason = case.verdict
    return verdict, reason.split(" by ")[0]


def shrink(case: Case, failing: Callable[[Case], bool] | None = None, tries: int = 200) -> Case:
    """The smallest case found that fails (None: in the way that this one does); `tries` at most are run."""
    if failing is None:
        kind = kind_of(case)
        if kind[0] not in (SILENT, WRONG):
            return case  # alone it does not fail

        def failing(smaller: Case) -> bool:
            return kind_of(smaller) == kind

    for _ in range(ROUNDS):
        before = case
        for simpler in SIMPLER:
            place = 0
            while place < len(options := simpler(case)) and tries > 0:
                tries -= 1
                smaller = _attempt(options[place], failing)
                if smaller is None:
                    place += 1
                else:
                    case = smaller
        if case is before:
            break
    return case


def _attempt(make: Callable[[], Case], failing: Callable[[Case], bool]) -> Case | None:
    """The case that is made if it is legal and fails."""
    try:
        case = make()
        return case if failing(case) else None
    except (ValueError, RuntimeError, ArithmeticError):
        return None
