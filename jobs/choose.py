"""The executor of tasks, chosen by the user's options."""

from contextlib import AbstractContextManager, nullcontext

from zwidth.jobs.cluster import Cluster
from zwidth.jobs.executor import Executor, Local, Processes


def executor(
    cluster: str | None = None, processes: int | None = None
) -> AbstractContextManager[Executor]:
    """Return an executor of tasks, for a `with` statement.

    cluster: address of a Dask scheduler (tcp://host:8786), or the file that it wrote its address
    to. processes: how many on this machine; None: threads of this process. Raises ValueError if
    both are given, a package is missing, no scheduler answers, or there is no worker.
    """
    if cluster is not None:
        if processes is not None:
            raise ValueError("both processes and a cluster are given; give only one")
        return Cluster(cluster)
    return nullcontext(Local() if processes is None else Processes(processes))
