"""Feeds mutated files to a reader in a process of its own: what it survives, and what it does not.

An input fails when the reader raises anything but a `RetargetError` of one line, gives a warning, ends its process, needs more than
`HANG_S` of processor time, or more than `MEMORY_BYTES` above what the process had. Input k of a reader is the same in every run.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import multiprocessing
import os
import random
import resource
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from retarget.core.errors import RetargetError

from tests.fuzz.corpus import TARGETS, Target

HANG_S = 2.0
MEMORY_BYTES = 512 << 20
_LARGEST_FINDINGS = 20


@dataclass(frozen=True)
class Finding:
    """One input that broke its reader. kind: what happened, the same text for the same fault. detail: the traceback, where there is one."""

    index: int
    kind: str
    detail: str = ""


@dataclass
class Outcome:
    """What a run saw. inputs: how many were read; accepted: how many gave something."""

    target: str
    inputs: int = 0
    accepted: int = 0
    seconds: float = 0.0
    slowest_s: float = 0.0
    findings: list[Finding] = field(default_factory=list)


def mutated(target: Target, seeds: list[bytes], index: int) -> bytes:
    """Input `index`: the seeds themselves first, then their mutations."""
    if index < len(seeds):
        return seeds[index]
    rng = random.Random(f"{target.name}/{index}")
    return rng.choice(target.mutations)(rng, rng.choice(seeds))


def run(name: str, *, count: int, seconds: float = 1e9, first: int = 0) -> Outcome:
    """Inputs `first` to `first + count - 1` of the reader `name`, at most for so long; stops early at `_LARGEST_FINDINGS` different faults."""
    target, outcome = TARGETS[name], Outcome(name)
    started = time.monotonic()
    at, end = first, first + count
    # Workers that are killed leave their files here.
    with tempfile.TemporaryDirectory(prefix="retarget-fuzz-") as folder:
        while at < end and time.monotonic() - started < seconds and len(outcome.findings) < _LARGEST_FINDINGS:
            at = _run_worker(target, outcome, at, end, started + seconds, folder)
    outcome.seconds = time.monotonic() - started
    return outcome


def _run_worker(target: Target, outcome: Outcome, at: int, end: int, until: float, folder: str) -> int:
    """One process, until it has read all, or is gone; the index to go on at."""
    fork = multiprocessing.get_context("fork")
    place = fork.RawArray("q", 2)
    here, there = fork.Pipe(duplex=False)
    place[0] = at
    worker = fork.Process(target=_work, args=(target.name, at, end, until, folder, place, there), daemon=True)
    worker.start()
    there.close()
    with here, contextlib.suppress(EOFError):
        while True:
            message = here.recv()
            if isinstance(message, Finding):
                if message.kind not in {finding.kind for finding in outcome.findings}:
                    outcome.findings.append(message)
            else:
                outcome.slowest_s = max(outcome.slowest_s, message)
    worker.join()
    done = int(place[0])
    outcome.accepted += int(place[1])
    outcome.inputs += done - at
    if worker.exitcode == 0:
        return done
    kind = ended(worker.exitcode or 0)
    if worker.exitcode != TOO_MUCH or not any(finding.kind == kind for finding in outcome.findings):
        outcome.findings.append(Finding(done, kind))
    outcome.inputs += 1
    return done + 1


TOO_MUCH = 77
"""Exit code of a process that took more memory than an input may."""


def ended(exitcode: int) -> str:
    """Why a process that reads inputs ended, from its exit code, which is not 0."""
    return {
        -signal.SIGPROF: f"no answer after {HANG_S:g} s of processor time",
        TOO_MUCH: f"more than {MEMORY_BYTES >> 20} MB of memory",
    }.get(exitcode, f"the process ended with {exitcode}")


def prepare(target: Target, folder: str) -> Callable[[], bool]:
    """Make this process one that reads inputs of `target`, its files in `folder`; → whether it has since taken too much memory."""
    tempfile.tempdir = folder
    faulthandler.disable()
    signal.signal(signal.SIGPROF, signal.SIG_DFL)  # ends the process, in whatever library it hangs
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _read(target, next(iter(target.seeds())))  # what is imported and cached on first use doesn't count
    gc.collect()
    usual = peak_bytes()
    resource.setrlimit(resource.RLIMIT_AS, (_pages(0) + 4 * MEMORY_BYTES, resource.RLIM_INFINITY))
    return lambda: peak_bytes() > usual + MEMORY_BYTES


def _work(name: str, at: int, end: int, until: float, folder: str, place: Any, pipe: Connection) -> None:
    target = TARGETS[name]
    took_too_much = prepare(target, folder)
    seeds = list(target.seeds())
    slowest = 0.0
    for index in range(at, end):
        place[0] = index
        if time.monotonic() > until:
            break
        data = mutated(target, seeds, index)
        signal.setitimer(signal.ITIMER_PROF, HANG_S)
        before = time.process_time()
        finding = judge(target, data, index, place)
        slowest = max(slowest, time.process_time() - before)
        signal.setitimer(signal.ITIMER_PROF, 0)
        if finding:
            pipe.send(finding)
        if took_too_much():
            pipe.send(slowest)
            os._exit(TOO_MUCH)
    else:
        place[0] = end
    pipe.send(slowest)


def judge(target: Target, data: bytes, index: int, place: Any) -> Finding | None:
    """What `data`, input `index`, breaks in its reader; where it gives something, place[1] is counted up."""
    try:
        problem = _read(target, data)
    except BaseException as error:
        kind = f"{type(error).__name__}: {' '.join(str(error).split())[:120]}"
        frames = traceback.extract_tb(error.__traceback__)
        if frames:
            kind = f"{type(error).__name__} at {frames[-1].filename.rsplit('/', 1)[-1]}:{frames[-1].lineno}"
        return Finding(index, kind, traceback.format_exc())
    if problem is None:
        place[1] += 1
    elif "\n" in problem or not problem:
        return Finding(index, "a message that is not one line", problem)
    elif len(problem) > 2000:
        return Finding(index, "a message of more than 2000 characters", problem[:200])
    return None


def _read(target: Target, data: bytes) -> str | None:
    """The error's text, or None where the input was accepted."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            found = target.read(data)
        except RetargetError as error:
            return str(error)
    for field_name in ("position", "orientation", "velocity"):
        values = getattr(found, field_name, None)
        if isinstance(values, np.ndarray) and not (field_name == "position" and hasattr(found, "measured")):
            assert np.isfinite(values).all(), f"{field_name} holds numbers that are not finite"
    return None


def peak_bytes() -> int:
    """The most memory that this process ever had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def resident_bytes() -> int:
    """Memory that this process has now."""
    return _pages(1)


def _pages(column: int) -> int:
    with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123 - not a file to handle as a path
        return int(file.read().split()[column]) * resource.getpagesize()


def minimal_report(outcome: Outcome) -> Iterator[str]:
    """Lines about an outcome."""
    yield (
        f"{outcome.target}: {outcome.inputs:,} inputs in {outcome.seconds:.0f} s, {outcome.accepted:,} accepted, "
        f"slowest {1000 * outcome.slowest_s:.0f} ms, {len(outcome.findings)} findings"
    )
    for finding in outcome.findings:
        yield f"  input {finding.index}: {finding.kind}"
