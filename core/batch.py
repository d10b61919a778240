"""The same work on many items, over any `concurrent.futures.Executor`: results in the order of the items, one failure per item.

What the work is, is the caller's business: a function and its items, both picklable when the executor is another process. A
function that needs something expensive per worker (a robot model) keeps it in a cache of its own module: workers live as long
as the executor, so it is made once in each.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from dataclasses import dataclass
from typing import Generic, TypeVar

from retarget.core.errors import RetargetError, UsageError

Item = TypeVar("Item")
Result = TypeVar("Result")

PARENT_GONE_GRACE_S = 2.0
"""How long a worker may take to clean up after its parent has died."""
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Outcome(Generic[Result]):
    """What became of one item.

    index: its place in the input. value: the function's result, None when it failed. error: one line, "" when it worked.
    exit_code: 0, that of the `RetargetError`, or 1 for an unexpected exception (then `unexpected` is True and `traceback` set).
    """

    index: int
    value: Result | None = None
    error: str = ""
    exit_code: int = 0
    unexpected: bool = False
    traceback: str = ""


def run(
    work: Callable[[Item], Result], items: Sequence[Item], executor: Executor | None = None
) -> Iterator[Outcome[Result]]:
    """Outcomes of `work(item)` for each of `items`, in their order, each as soon as it and all before it are done.

    Without an executor the work is done here, one item after the other. A failing item never stops the others. Raises
    `KeyboardInterrupt` when interrupted, here or in a worker; items that were done by then stay done.
    """
    if executor is None:
        for index, item in enumerate(items):
            yield attempt(work, index, item)
        return
    with _interrupt_held_back():
        futures = [executor.submit(attempt, work, index, item) for index, item in enumerate(items)]
    try:
        for index, future in enumerate(futures):
            yield _outcome(index, future)
    finally:
        for future in futures:
            future.cancel()


def attempt(work: Callable[[Item], Result], index: int, item: Item) -> Outcome[Result]:
    """`work(item)` with its exception turned into text: exceptions with a constructor of their own don't survive pickling."""
    try:
        with _worker_interrupts.let_through():
            return Outcome(index, work(item))
    except BrokenPipeError:
        raise  # nobody reads the output any more: not this item's fault, and the others have no reader either
    except RetargetError as error:
        return Outcome(index, error=str(error), exit_code=error.exit_code, traceback=traceback.format_exc())
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        return Outcome(index, error=f"{place}{error.strerror or error}", exit_code=1, traceback=traceback.format_exc())
    except Exception as error:
        text = f"{type(error).__name__}: {error}".strip().replace("\n", " ")
        return Outcome(index, error=text, exit_code=1, unexpected=True, traceback=traceback.format_exc())


def shard(items: Sequence[Item], number: int, count: int) -> list[Item]:
    """Every `count`-th of `items` from the `number`-th on, `number` from 1: the shards 1…count are disjoint and cover all items."""
    if count < 1 or not 1 <= number <= count:
        raise UsageError(f"shard {number}/{count}; expected i/n with 1 ≤ i ≤ n")
    return list(items[number - 1 :: count])


@contextlib.contextmanager
def process_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of `workers` fresh processes, one BLAS thread each (unless the environment says otherwise).

    Started by spawn: a forked copy of a process that holds threads or an open HDF5 file can lock up. When the block is left by an
    interrupt, workers are interrupted too instead of finishing their item.
    """
    elder = set(multiprocessing.active_children())
    saved = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    for name in THREAD_VARIABLES:
        os.environ.setdefault(name, "1")
    executor = ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare_worker
    )
    try:
        yield executor
    except BaseException:
        for child in set(multiprocessing.active_children()) - elder:
            if child.pid is not None:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(child.pid, signal.SIGINT)
        raise
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
        for name, value in saved.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _outcome(index: int, future: Future[Outcome[Result]]) -> Outcome[Result]:
    try:
        return future.result()
    except BrokenExecutor:
        return Outcome(index, error="its worker process died (killed, or out of memory)", exit_code=1)


class _WorkerInterrupts:
    """Ctrl-C in a worker, which a terminal sends to the whole process group and `process_pool` sends as well.

    It stops the item at work once, so that half-written files are removed undisturbed; idle workers stay silent; and items that
    already wait in the pool's queue are not begun.
    """

    def __init__(self) -> None:
        self.interrupted = self.working = False

    def install(self) -> None:
        """First thing in a worker; until here the signal was held back."""
        signal.signal(signal.SIGINT, self._receive)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})

    def _receive(self, _signal: int, _frame: object) -> None:
        first, self.interrupted = not self.interrupted, True
        if first and self.working:
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def let_through(self) -> Iterator[None]:
        """While one item is worked on. Does nothing outside workers."""
        self.working = True
        try:
            if self.interrupted:
                raise KeyboardInterrupt
            yield
        finally:
            self.working = False


_worker_interrupts = _WorkerInterrupts()


def _prepare_worker() -> None:
    _worker_interrupts.install()
    threading.Thread(target=_leave_with_parent, name="leave-with-parent", daemon=True).start()


def _leave_with_parent() -> None:
    """End this worker when its parent is gone: killed, it can't stop the pool, whose workers would finish the queue and then wait forever.

    The item at work is interrupted first, so that it can clean up.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    parent.join()
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(PARENT_GONE_GRACE_S)
    os._exit(1)


@contextlib.contextmanager
def _interrupt_held_back() -> Iterator[None]:
    """Processes started inside begin with Ctrl-C blocked, so that none prints a traceback before it is ready; here it only waits."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
