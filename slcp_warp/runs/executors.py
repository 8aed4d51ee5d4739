"""Who computes chunks: processes of this machine, a Dask cluster, SLURM through submitit, or any executor.

All of them only start `worker.work` somewhere; the store is where workers meet. What they need of each other
is in `Workers`.
"""

import asyncio
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError
from typing import Any

from ..inputs.checks import choice, shown, whole
from ..inputs.errors import ArgumentError, ArgumentTypeError
from .local import Pools

AHEAD = 2  # chunks in flight a worker: one that it computes, and the next


class WorkerError(OSError):
    """Workers end, or cannot begin, so that a job gets nowhere; the message says what is known."""


class Workers:
    """Workers behind an executor: `submit(function, *arguments) -> future`, of `concurrent.futures`' kind.

    Attributes:
        lost: errors of a future whose worker is gone; its chunks are computed again.
        shares: a worker gets its share of all chunks at once, where it takes long until one begins.
    """

    lost: tuple[type[BaseException], ...] = (BrokenExecutor, CancelledError)
    shares: bool = False

    def __init__(self, executor: Any) -> None:
        self.executor = executor

    def count(self) -> int:
        """How many chunks can be computed at once."""
        return int(getattr(self.executor, "_max_workers", 0) or os.cpu_count() or 1)

    def begin(self, folder: str) -> None:
        """Be ready for the chunks of a store."""

    def submit(self, function: Callable[..., Any], arguments: Sequence[tuple]) -> list[Any]:
        """Futures of a function's calls."""
        return [self.executor.submit(function, *each) for each in arguments]

    def error(self, error: BaseException) -> BaseException:
        """The error of a future as it is told."""
        return error

    def cancel(self, futures: Iterable[Any]) -> None:
        """Futures that have not begun need not."""
        for future in futures:
            future.cancel()

    def abandon(self) -> None:
        """Give up what is in flight, where that is ours to do."""

    def close(self) -> None:
        """End workers that belong to it."""

    def __enter__(self) -> "Workers":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Processes(Workers):
    """Processes of this machine (see `processes`)."""

    def __init__(self, count: int, devices: Sequence[str] | None) -> None:
        self.pools = Pools(count, devices)
        super().__init__(self.pools)

    def count(self) -> int:
        """How many there are."""
        return len(self.pools)

    def error(self, error: BaseException) -> BaseException:
        """Whether they could begin at all."""
        return WorkerError(self.pools.unborn) if self.pools.unborn else error

    def cancel(self, futures: Iterable[Any]) -> None:
        """The one that waits for each is in its queue already, from where no future comes back."""

    def abandon(self) -> None:
        """End them at once; the next chunk starts new ones."""
        self.pools.kill()

    def close(self) -> None:
        """End them."""
        self.pools.kill()


class Dask(Workers):
    """A Dask client's workers (see `dask`)."""

    def __init__(self, client: Any, owned: Any = None) -> None:
        from distributed import CancelledError as Cancelled
        from distributed import KilledWorker
        from distributed.comm.core import CommClosedError

        super().__init__(client.get_executor(pure=False))  # the same chunk may have to be computed again
        self.client, self.owned = client, owned
        self.lost = (*Workers.lost, KilledWorker, Cancelled, CommClosedError, asyncio.CancelledError)

    def count(self) -> int:
        """Threads of all workers that there are now."""
        return sum(self.client.nthreads().values())

    def close(self) -> None:
        """Close the cluster if it was started for this."""
        for each in reversed(self.owned or ()):
            each.close()


class Slurm(Workers):
    """Jobs of SLURM, or processes that stand for them (see `slurm`)."""

    shares: bool = True

    def __init__(self, jobs: int, cluster: str | None, parameters: dict[str, Any]) -> None:
        import submitit

        self.jobs, self.cluster, self.parameters = jobs, cluster, parameters
        self.lost = (*Workers.lost, submitit.core.utils.UncompletedJobError)
        self.running: list[Any] = []

    def count(self) -> int:
        """Jobs at once."""
        return self.jobs

    def begin(self, folder: str) -> None:
        """Jobs keep what they say in `slurm/` of the store."""
        import submitit

        self.executor = submitit.AutoExecutor(folder=os.path.join(folder, "slurm"), cluster=self.cluster)
        self.executor.update_parameters(**self.parameters)

    def submit(self, function: Callable[..., Any], arguments: Sequence[tuple]) -> list[Any]:
        """An array of jobs."""
        self.running = self.executor.map_array(function, *zip(*arguments))
        return list(self.running)

    def error(self, error: BaseException) -> BaseException:
        """Of an error in a job its last line, which says what and where."""
        lines = [line for line in str(error).splitlines() if line.strip()]
        last = next((line for line in reversed(lines) if line[:1].isalpha() and ": " in line), str(error))
        return WorkerError(f"a job of submitit failed: {last.strip()}")

    def cancel(self, futures: Iterable[Any]) -> None:
        """Every job has begun."""

    def abandon(self) -> None:
        """Cancel the jobs; they are computed again."""
        for job in self.running:
            job.cancel(check=False)

    close = abandon


def processes(count: int | None = None, devices: Sequence[str] | None = None) -> Workers:
    """Processes of this machine as an executor of chunks.

    The cores are shared between them (SLCP_WARP_THREADS, where it is set, says how many each has). They end
    with this process. A script that starts them needs its own calls below `if __name__ == "__main__":`.

    Args:
        count: how many, default one a core, or one a device.
        devices: one process for each of these GPUs, ("cuda:0", "cuda:1").
    """
    names = [] if devices is None or isinstance(devices, str) else list(devices)
    if devices is not None and (not names or not all(isinstance(name, str) for name in names)):
        raise ArgumentError(f'devices is {shown(devices)}; names of GPUs, ("cuda:0", "cuda:1"), are needed')
    if count is None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        count = len(names) or cores
    return Processes(whole("count", count, 1, 1024), names or None)


def dask(cluster: Any = None) -> Workers:
    """The workers of a Dask cluster as an executor of chunks.

    Workers need the same version of this package and the store's folder, on a disk that all share. A worker
    with one thread has all its cores for a chunk's worlds.

    Args:
        cluster: a `distributed.Client`; an address ("tcp://10.0.0.1:8786"); a number of processes on this
            machine, which end with `close`; None: one a core.
    """
    try:
        import distributed
    except ImportError as error:
        raise ImportError("Dask's workers need dask: pip install 'slcp-warp[dask]'") from error
    if isinstance(cluster, distributed.Client):
        return Dask(cluster)
    if isinstance(cluster, str):
        client = distributed.Client(cluster, timeout="20s")
        return Dask(client, [client])
    count = whole("cluster", os.cpu_count() if cluster is None else cluster, 1, 1024)
    threads = os.environ.get("SLCP_WARP_THREADS") or str(max(1, (os.cpu_count() or 1) // count))
    local = distributed.LocalCluster(
        n_workers=count, threads_per_worker=1, processes=True, protocol="tcp", dashboard_address=None,
        env={"SLCP_WARP_THREADS": threads},
    )  # fmt: skip
    client = distributed.Client(local)
    return Dask(client, [local, client])


def slurm(jobs: int = 2, cluster: str | None = None, **parameters: Any) -> Workers:
    """Jobs of SLURM, an array of them, as an executor of chunks, through submitit.

    Every job takes its share of the chunks; one that SLURM ends early and begins again goes on from the
    store. Jobs need the same environment and the store's folder, on a disk that all share.

    Args:
        jobs: how many at once.
        cluster: "slurm"; "local": processes of this machine in their place; None: SLURM where there is one.
        parameters: of `submitit.AutoExecutor.update_parameters`: timeout_min, cpus_per_task,
            slurm_partition, gpus_per_node, ...
    """
    try:
        import submitit  # noqa: F401
    except ImportError as error:
        raise ImportError("jobs of SLURM need submitit: pip install 'slcp-warp[slurm]'") from error
    choice("cluster", cluster, ("slurm", "local", None))
    return Slurm(whole("jobs", jobs, 1, 100_000), cluster, {"timeout_min": 60, "name": "slcp"} | parameters)


def workers_of(executor: Any) -> Workers:
    """What is behind an executor: one of this module, a Dask client, or anything with `submit`."""
    if isinstance(executor, Workers):
        return executor
    if type(executor).__module__.split(".")[0] == "distributed" and hasattr(executor, "get_executor"):
        return Dask(executor)
    if callable(getattr(executor, "submit", None)):
        return Workers(executor)
    raise ArgumentTypeError(
        f"executor is a {type(executor).__name__}; None, slcp.runs.processes(), dask(), slurm(), or an "
        "executor with submit(function, *arguments) is needed"
    )
