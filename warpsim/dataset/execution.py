"""Who does the work: this process, a pool of processes, or any executor of `concurrent.futures`."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

import warp as wp

from warpsim.dataset.shard import Receipt, Task, write_shard
from warpsim.errors import InputError

MOST_LOSSES = 3
"""Pools in a row whose workers were killed before a single shard was done."""


def run_tasks(tasks: Sequence[Task], executor: Executor | None, n_worker: int, done: Callable[[Receipt], None]) -> None:
    """Have all tasks done; `done` is called with each receipt, in this thread.

    Args:
        tasks: What is to be done.
        executor: Who does it; its workers must see the folder that tasks write to.
        n_worker: Processes of a pool of our own, where no executor is given; 1: this process.
        done: Takes receipts.

    Raises:
        InputError: A task cannot be done.
        OSError: Writing failed, or workers were lost.
    """
    if executor is not None:
        _collect([executor.submit(write_shard, task) for task in tasks], done)
    elif n_worker == 1:
        for task in tasks:
            done(write_shard(task))
    else:
        _run_in_pools(tasks, n_worker, done)


def _run_in_pools(tasks: Sequence[Task], n_worker: int, done: Callable[[Receipt], None]) -> None:
    """Pools of processes: when one of them is killed, its pool is lost, and another one goes on."""
    left = {task.shard.name: task for task in tasks}
    n_loss = 0
    while left:
        before = len(left)

        def keep(receipt: Receipt) -> None:
            del left[receipt["shard"]]
            done(receipt)

        pool = _pool(min(n_worker, len(left)))
        try:
            _collect([pool.submit(write_shard, task) for task in left.values()], keep)
            pool.shutdown()
        except BaseException as error:
            _end(pool)
            if not isinstance(error, BrokenProcessPool):
                raise
            n_loss = n_loss + 1 if len(left) == before else 1
            if n_loss == MOST_LOSSES:
                raise OSError("worker processes were killed again and again (is there memory enough?)") from None


def _collect(futures: Iterable[Future[Receipt]], done: Callable[[Receipt], None]) -> None:
    """Take receipts as they come; at the first failure what has not begun is called off."""
    futures = list(futures)
    try:
        for future in as_completed(futures):
            done(future.result())
    except BaseException as error:
        for future in futures:
            future.cancel()
        if isinstance(error, InputError | OSError | BrokenProcessPool | KeyboardInterrupt | SystemExit):
            raise
        raise OSError(f"workers were lost: {type(error).__name__}: {error}") from error


def _pool(n_worker: int) -> ProcessPoolExecutor:
    """Fresh processes: Warp and its threads do not live on in forked ones."""
    return ProcessPoolExecutor(n_worker, multiprocessing.get_context("spawn"), _begin_worker)


def _end(pool: ProcessPoolExecutor) -> None:
    """End the workers of a pool at once: what they have not finished lies in folders of their own."""
    processes = list((pool._processes or {}).values())  # no public way leads to them before Python 3.14
    for process in processes:
        process.kill()
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.join()


def _begin_worker() -> None:
    """A worker leaves interrupts to its parent, ends when that is gone, and prints nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    wp.config.log_level = wp.LOG_ERROR
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.pid,), daemon=True).start()


def _end_with(parent: int | None) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)
