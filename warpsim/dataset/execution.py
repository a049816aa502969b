"""Execution of tasks: in this process, a pool of processes, or any executor of `concurrent.futures`."""

from __future__ import annotations

import importlib
import itertools
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from typing import Any

import warp as wp

from warpsim.dataset.shard import Task, work_of_run, write_shard
from warpsim.errors import InputError
from warpsim.output.output_folder import CheckpointRecord

MOST_WAITING = 4096
"""Tasks that an executor knows of at a time: more than workers of any cluster, and few to hold."""

MOST_LOSSES = 3
"""Pools in a row whose workers were killed before a single shard was done."""


class WorkersLostError(OSError):
    """An executor lost its workers."""


def run_tasks(
    tasks: Sequence[Task], executor: Executor | None, n_worker: int, done: Callable[[CheckpointRecord], None]
) -> None:
    """Run all tasks on an executor, or in n_worker processes (1: in this one); `done` gets each record, in this thread.

    The workers of an executor must see the folder that tasks write to. InputError: a task cannot be done; OSError:
    writing failed, or workers were lost.
    """
    if executor is not None:
        _collect(executor, tasks, done)
    elif n_worker == 1:
        try:
            for task in tasks:
                done(write_shard(task))
        finally:
            work_of_run.cache_clear()  # this process has other things to do
    else:
        _run_in_pools(tasks, n_worker, done)


def _run_in_pools(tasks: Sequence[Task], n_worker: int, done: Callable[[CheckpointRecord], None]) -> None:
    """Pools of processes: when one of them is killed, its pool is lost, and another one goes on."""
    left = {task.shard.name: task for task in tasks}
    n_loss = 0
    while left:
        before = len(left)

        def keep(record: CheckpointRecord) -> None:
            del left[record["shard"]]
            done(record)

        # Fresh processes: Warp and its threads do not live on in forked ones.
        spawn = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(min(n_worker, len(left)), spawn, _begin_worker)
        try:
            _collect(pool, list(left.values()), keep, is_own=True)
            pool.shutdown()
        except BaseException as error:
            _end(pool)
            if not isinstance(error, WorkersLostError):
                raise
            n_loss = n_loss + 1 if len(left) == before else 1
            if n_loss == MOST_LOSSES:
                raise OSError("worker processes were killed again and again (is there memory enough?)") from None


def _collect(
    executor: Executor, tasks: Iterable[Task], done: Callable[[CheckpointRecord], None], is_own: bool = False
) -> None:
    """Run tasks and collect their checkpoint records as they come; the first failure cancels those not begun.

    A pool of our own is ended by its caller; the workers of another executor are waited for.
    """
    coming, waiting = iter(tasks), set[Future[CheckpointRecord]]()
    try:
        while True:
            for task in itertools.islice(coming, MOST_WAITING - len(waiting)):
                with _naming_losses(everything=True):
                    waiting.add(executor.submit(write_shard, task))
            if not waiting:
                return
            ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            # What is done counts, whatever else was not.
            for future in sorted(ready, key=lambda one: one.cancelled() or one.exception() is not None):
                with _naming_losses():
                    record = future.result()
                done(record)
    except BaseException as error:
        for future in waiting:
            future.cancel()
        if isinstance(error, Exception) and not isinstance(error, WorkersLostError) and not is_own:
            wait(waiting)  # what has begun ends by itself, and then the folder is nobody's
        raise


@contextmanager
def _naming_losses(everything: bool = False) -> Iterator[None]:
    """Errors of executors, not of the work, as such; or all errors but interrupts."""
    try:
        yield
    except Exception as error:
        of_executor = type(error).__module__.partition(".")[0] in ("distributed", "dask", "concurrent")
        if not (everything or of_executor):
            raise
        raise WorkersLostError(f"workers were lost: {type(error).__name__}: {error}".removesuffix(": ")) from error


def _end(pool: ProcessPoolExecutor) -> None:
    """End the workers of a pool at once: unfinished files are in folders of each worker."""
    processes = list((pool._processes or {}).values())  # no public way leads to them before Python 3.14
    for process in processes:
        process.kill()
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.join()


def _begin_worker() -> None:
    """Initialise a worker: it ignores interrupts, ends with its parent, and prints nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    wp.config.log_level = wp.LOG_ERROR
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.pid,), daemon=True).start()


def _end_with(parent: int | None) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


CONNECT_TIMEOUT_S = 20


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """The workers of a Dask cluster, by its scheduler's address (tcp://HOST:PORT); InputError without either."""
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise InputError("needs the package distributed: pip install 'warpsim[cluster]'", "--scheduler") from None
    try:
        client = distributed.Client(address, timeout=CONNECT_TIMEOUT_S)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"must be the address of a Dask scheduler, got {address!r}: {reason}", "--scheduler") from None
    with client:
        yield client.get_executor()
