"""Where tasks run, chosen from what the user asks for."""

from contextlib import AbstractContextManager, nullcontext

from zwidth.jobs.cluster import Cluster
from zwidth.jobs.executor import Executor, Local, Processes


def executor(
    cluster: str | None = None, processes: int | None = None
) -> AbstractContextManager[Executor]:
    """Return what tasks run on, for a `with` statement.

    cluster: address of a Dask scheduler (tcp://host:8786), or the file it wrote its address to.
    processes: on this machine; None: in this process, on threads. Raises ValueError for both, for a
    missing package, and where no scheduler answers or no worker is there.
    """
    if cluster is not None:
        if processes is not None:
            raise ValueError("processes on this machine and a cluster exclude each other; give one")
        return Cluster(cluster)
    return nullcontext(Local() if processes is None else Processes(processes))
