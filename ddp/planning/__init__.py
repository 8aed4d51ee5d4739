"""A plan in one call, of controls that may act some steps after they are sent."""

from .late import Late as Late
from .late import delay_of as delay_of
from .plan import METHODS as METHODS
from .plan import SCHEDULES as SCHEDULES
from .plan import compile_kernels as compile_kernels
from .plan import noise_scale as noise_scale
from .plan import plan as plan
from .plan import plan_late as plan_late
from .plan import plan_starts as plan_starts
from .plan import problem_of as problem_of
from .plan import random_starts as random_starts
from .plan import solve_starts as solve_starts
