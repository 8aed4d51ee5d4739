"""Many starts of one problem: in one batch, or in chunks that are kept on disk and spread over workers."""

from .solve import SCHEDULES as SCHEDULES
from .solve import Multistart as Multistart
from .solve import solve_multistart as solve_multistart
