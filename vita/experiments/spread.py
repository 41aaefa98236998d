"""Where jobs are done: in this process, in several, or on a Dask cluster. The results are the same."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from vita.errors import BadInput, MissingDependency
from vita.experiments.base import Job

Finished = Iterator[tuple[int, Any]]
"""Index of a job and its result, in the order in which they are done."""
ANSWER_S = 10
"""How long a scheduler may take to answer [s]."""


def results_of(
    jobs: Sequence[Job],
    workers: int = 1,
    scheduler: str = "",
    done: Callable[[int, Job], None] = lambda count, job: None,
) -> list[Any]:
    """The results in the order of `jobs`; `done` hears of every finished job.

    With a `scheduler`, an address like tcp://host:8786, its workers do them; otherwise `workers`
    processes of this machine.
    """
    if workers < 1:
        raise BadInput(f"needs at least one worker, got {workers}", "workers")
    if scheduler:
        finished = _on_cluster(jobs, scheduler)
    elif min(workers, len(jobs)) > 1:
        finished = _in_processes(jobs, min(workers, len(jobs)))
    else:
        finished = ((i, _do(job)) for i, job in enumerate(jobs))
    results: list[Any] = [None] * len(jobs)
    for count, (i, result) in enumerate(finished, 1):
        results[i] = result
        done(count, jobs[i])
    return results


def _do(job: Job) -> Any:
    return job.work(**job.arguments)


def _in_processes(jobs: Sequence[Job], workers: int) -> Finished:
    # Fresh interpreters: a fork would copy the locks of whatever threads this process has.
    context = multiprocessing.get_context("spawn")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # The workers share the cores already.
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(workers, context, _leave_interrupts) as pool:
        try:
            index = {pool.submit(_do, job): i for i, job in enumerate(jobs)}
            for future in as_completed(index):
                yield index[future], future.result()
        except BrokenProcessPool:
            why = "a worker process was ended from outside, perhaps for want of memory"
            raise MissingDependency(f"{why}; try fewer --workers") from None
        except BaseException:
            # Whoever has pressed Ctrl-C does not want to wait for jobs that have begun.
            pool.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()) - others:
                child.terminate()
            raise


def _leave_interrupts() -> None:
    """Ctrl-C reaches every process of the terminal: only the first one answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _on_cluster(jobs: Sequence[Job], address: str) -> Finished:
    try:
        from distributed import Client  # pyright: ignore[reportMissingImports]
        from distributed import as_completed as finished  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError:
        raise MissingDependency(
            "--scheduler needs the package 'distributed'; install vita with it: pip install 'vita[dask]'"
        ) from None
    try:
        client = Client(address, timeout=ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise MissingDependency(f"no Dask scheduler answers at {address!r}: {error}") from None
    with client:
        # Not pure: equal arguments are not looked up among the results of earlier commands.
        index = {client.submit(_do, job, pure=False): i for i, job in enumerate(jobs)}
        try:
            for future in finished(index, loop=client.loop):
                yield index[future], future.result()
        except ModuleNotFoundError as error:
            raise MissingDependency(f"the workers of {address} lack a package: {error}") from None
        finally:
            client.cancel(list(index))
