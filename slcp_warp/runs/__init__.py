"""Long computations in chunks: a job, its store on disk, executors that share the work, progress.

Nothing here knows what is computed. A job says how many chunks there are and what is in each; the store
keeps every finished one; which are missing decides what is left to do. `processes`, `dask` and `slurm` give
executors for what takes one (``executor=``).
"""

from .executors import WorkerError, Workers, dask, processes, slurm
from .job import Job, makes_jobs, reference_to
from .progress import Standing
from .running import Outcome, run
from .store import Store

__all__ = [
    "Job",
    "Outcome",
    "Standing",
    "Store",
    "WorkerError",
    "Workers",
    "dask",
    "makes_jobs",
    "processes",
    "reference_to",
    "run",
    "slurm",
]
