"""Integer codes that the solver kernels write; `ddp.Status` gives them names."""

RUNNING = -1
CONVERGED = 0
SMALL_IMPROVEMENT = 1
MAX_ITERATIONS = 2
REGULARIZATION_LIMIT = 3
LINE_SEARCH_FAILED = 4
DYNAMICS_FAILED = 5
FLAT = 6
STATE_LIMITS = 7

NOT_FINITE = 1000  # of a candidate whose rollout left the numbers, and of derivatives

# Columns of the trace (B, max_iterations + 1, TRACE_COLUMNS): one row a pass, NaN where nothing was written.
TRACE_COST, TRACE_REDUCTION, TRACE_RATIO, TRACE_STEP_SIZE, TRACE_EXPECTED = 0, 1, 2, 3, 4  # line search
TRACE_REGULARIZATION, TRACE_GRADIENT, TRACE_PIVOT, TRACE_RESTARTS = 5, 6, 7, 8  # backward pass
TRACE_COLUMNS = 9

# Columns of a regularisation schedule (1 or B, SCHEDULE_COLUMNS), float64.
SCHEDULE_INITIAL, SCHEDULE_FACTOR, SCHEDULE_MIN, SCHEDULE_MAX, SCHEDULE_STATE, SCHEDULE_CONTROL = (
    0,
    1,
    2,
    3,
    4,
    5,
)
SCHEDULE_COLUMNS = 6
