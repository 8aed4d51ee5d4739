"""All cases of the stability battery, in the order of its table (docs/understand/stability.md)."""

from .bodies import BODY_CASES
from .case import Case
from .disc import DISC_CASES
from .guides import GUIDE_CASES
from .heaps import HEAP_CASES
from .joint import JOINT_CASES
from .pile import PILE_CASES

CASES: tuple[Case, ...] = (*DISC_CASES, *BODY_CASES, *PILE_CASES, *JOINT_CASES, *GUIDE_CASES, *HEAP_CASES)
