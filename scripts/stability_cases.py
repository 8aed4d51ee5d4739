"""All cases of the stability battery, in the order of its table (docs/understand/stability.md)."""

from .stability_bodies import BODY_CASES
from .stability_case import Case
from .stability_disc import DISC_CASES
from .stability_guides import GUIDE_CASES
from .stability_joint import JOINT_CASES
from .stability_pile import PILE_CASES

CASES: tuple[Case, ...] = (*DISC_CASES, *BODY_CASES, *PILE_CASES, *JOINT_CASES, *GUIDE_CASES)
