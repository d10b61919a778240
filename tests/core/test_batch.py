"""`core.batch`: order, isolation of failures, one model per worker, interrupts, over threads, processes and no executor at all."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st
from retarget.core import batch
from retarget.core.errors import UsageError

WORK = Path(__file__).with_name("batch_work.py")


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module `batch_work`, importable in workers too: they start with this process's search path."""
    monkeypatch.syspath_prepend(str(WORK.parent))
    return importlib.import_module(WORK.stem)


@pytest.mark.parametrize("kind", ["none", "threads", "processes"])
def test_outcomes_keep_the_order_of_the_items(kind: str, work: ModuleType) -> None:
    items = [7, 3, 9, 0, 4]
    if kind == "none":
        outcomes = list(batch.run(work.slow_square, items))
    elif kind == "threads":
        with ThreadPoolExecutor(4) as pool:
            outcomes = list(batch.run(work.slow_square, items, pool))
    else:
        with batch.process_pool(2) as processes:
            outcomes = list(batch.run(work.slow_square, items, processes))
    assert [o.value for o in outcomes] == [49, 9, 81, 0, 16]
    assert [o.index for o in outcomes] == [0, 1, 2, 3, 4]
    assert {o.exit_code for o in outcomes} == {0}


@pytest.mark.parametrize("processes", [False, True])
def test_a_failing_item_stops_no_other_and_says_why(processes: bool, work: ModuleType) -> None:
    if processes:
        with batch.process_pool(2) as pool:
            outcomes = list(batch.run(work.picky, range(5), pool))
    else:
        outcomes = list(batch.run(work.picky, range(5)))
    assert [o.value for o in outcomes] == [0, None, None, None, 4]
    expected, unexpected, file_error = outcomes[1:4]
    assert (expected.error, expected.exit_code) == ("one.mvnx: no frames; expected at least one", 1)
    assert not expected.unexpected
    assert (unexpected.error, unexpected.exit_code, unexpected.unexpected) == ("ZeroDivisionError: two lines", 1, True)
    assert "in picky" in unexpected.traceback
    assert (file_error.error, file_error.unexpected) == ("three.mvnx: No such file or directory", False)


def test_usage_errors_keep_their_exit_code() -> None:
    def refuse(_item: int) -> None:
        raise UsageError("no")

    assert [o.exit_code for o in batch.run(refuse, [0])] == [2]


def test_what_a_worker_caches_is_made_once_in_each_and_blas_has_one_thread(
    work: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    with batch.process_pool(2) as pool:
        found = [o.value for o in batch.run(work.where_built, range(12), pool)]
    assert "OMP_NUM_THREADS" not in os.environ
    by_worker: dict[int, set[tuple[int, float]]] = {}
    for worker, built, threads in found:
        by_worker.setdefault(worker, set()).add(built)
        assert threads == "1"
    assert len(by_worker) == 2
    assert os.getpid() not in by_worker
    for worker, built in by_worker.items():
        assert [pid for pid, _ in built] == [worker]


def test_a_killed_worker_is_reported_not_waited_for(work: ModuleType) -> None:
    with batch.process_pool(1) as pool:
        outcomes = list(batch.run(work.die, [0, 1, 2], pool))
    assert outcomes[0].value == 0
    assert [o.error for o in outcomes[1:]] == ["its worker process died (killed, or out of memory)"] * 2


def test_an_interrupt_reaches_the_workers_who_clean_up(work: ModuleType, tmp_path: Path) -> None:
    paths = [str(tmp_path / name) for name in ("a", "b", "c", "d")]

    def interrupt_when_started() -> None:
        deadline = time.monotonic() + 60
        while len(list(tmp_path.glob("*.started"))) < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    interrupter = threading.Thread(target=interrupt_when_started)
    interrupter.start()
    with pytest.raises(KeyboardInterrupt), batch.process_pool(2) as pool:
        list(batch.run(work.write_until_interrupted, paths, pool))
    interrupter.join()
    started = {path.stem for path in tmp_path.glob("*.started")}
    assert started == {path.stem for path in tmp_path.glob("*.cleaned")}
    assert len(started) == 2
    assert not multiprocessing.active_children()


def test_results_come_before_the_last_item_is_done() -> None:
    release = threading.Event()

    def wait_for_last(number: int) -> int:
        if number == 1:
            release.wait(30)
        return number

    with ThreadPoolExecutor(2) as pool:
        outcomes = batch.run(wait_for_last, [0, 1], pool)
        assert next(outcomes).value == 0
        release.set()
        assert next(outcomes).value == 1


def test_abandoned_work_is_cancelled() -> None:
    done = []

    def remember(number: int) -> int:
        time.sleep(0.01)
        done.append(number)
        return number

    with ThreadPoolExecutor(1) as pool:
        outcomes = batch.run(remember, range(200), pool)
        next(outcomes)
        outcomes.close()
    assert len(done) < 100


@given(items=st.lists(st.integers()), count=st.integers(1, 12))
def test_shards_are_disjoint_and_cover_everything_in_order(items: list[int], count: int) -> None:
    positions = list(enumerate(items))
    shards = [batch.shard(positions, number, count) for number in range(1, count + 1)]
    assert sorted(item for part in shards for item in part) == positions
    assert all(part == sorted(part) for part in shards)
    assert max(map(len, shards)) - min(map(len, shards)) <= 1


@pytest.mark.parametrize(("number", "count"), [(0, 3), (4, 3), (1, 0), (-1, 2)])
def test_shards_outside_the_range_are_refused(number: int, count: int) -> None:
    with pytest.raises(UsageError, match="expected i/n with 1 ≤ i ≤ n"):
        batch.shard([1, 2, 3], number, count)
