"""`python -m tests.fuzz.guided --reader mvnx --seconds 1800`: inputs that reach new branches are kept and mutated further.

The same readers, mutations and faults as `python -m tests.fuzz`, led by Atheris (`pip install '.[fuzz]'`; Linux and macOS), which instruments this package and
the libraries that decode. Every run takes another way: what it finds is the file in `--findings`, not an input's index.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import multiprocessing
import os
import random
import signal
import sys
import tempfile
import time
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

INSTRUMENTED = ("retarget", "rosbags", "mcap", "tomllib", "json")


def main() -> int:
    import atheris

    with atheris.instrument_imports(include=list(INSTRUMENTED)), contextlib.redirect_stderr(io.StringIO()):
        from tests.fuzz.corpus import TARGETS
        from tests.fuzz.runner import Outcome, minimal_report

        for target in TARGETS.values():
            # Readers are imported when they are first needed.
            target.read(next(iter(target.seeds())))
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.guided", description=__doc__.partition("\n")[0])
    parser.add_argument("--reader", action="append", choices=TARGETS, help="repeat for several [default: all]")
    parser.add_argument("--seconds", type=float, default=1800.0, help="for each reader [default: 1800]")
    parser.add_argument(
        "--findings", type=Path, default=Path("findings"), help="folder for inputs that failed [default: findings]"
    )
    parser.add_argument(
        "--most", type=int, default=20, help="different faults of one reader, then it is left [default: 20]"
    )
    chosen = parser.parse_args()
    bad = False
    for name in chosen.reader or TARGETS:
        outcome, started = Outcome(name), time.monotonic()
        with tempfile.TemporaryDirectory(prefix="retarget-fuzz-") as folder:
            kept = Path(folder) / "kept"
            kept.mkdir()
            for number, seed in enumerate(TARGETS[name].seeds()):
                (kept / f"seed{number}").write_bytes(seed)
            # A process that was ended by its input is followed by another one, which goes on with what was kept.
            while (left := chosen.seconds - (time.monotonic() - started)) >= 1 and len(outcome.findings) < chosen.most:
                _run_worker(outcome, Path(folder), left, chosen.findings, chosen.most)
        outcome.seconds = time.monotonic() - started
        print("\n".join(minimal_report(outcome)), flush=True)
        bad = bad or bool(outcome.findings)
    return int(bad)


def _run_worker(outcome: Any, folder: Path, seconds: float, findings: Path, most: int) -> None:
    """One process, until the time is up or an input ended it; what it found goes into `outcome` and `findings`."""
    from tests.fuzz.runner import Finding, ended

    fork = multiprocessing.get_context("fork")
    counts = fork.RawArray("q", 2)
    here, there = fork.Pipe(duplex=False)
    worker = fork.Process(target=_work, args=(outcome.target, folder, seconds, most, counts, there), daemon=True)
    worker.start()
    there.close()
    found: list[tuple[Finding, bytes]] = []
    with here, contextlib.suppress(EOFError):
        while True:
            found.append(here.recv())
    worker.join()
    outcome.inputs += int(counts[0])
    outcome.accepted += int(counts[1])
    if worker.exitcode:
        found.append((Finding(0, ended(worker.exitcode)), (folder / "input").read_bytes()))
    for finding, data in found:
        if any(known.kind.startswith(f"{finding.kind} (") for known in outcome.findings):
            continue
        name = f"{outcome.target}-{hashlib.sha256(data).hexdigest()[:12]}"
        findings.mkdir(parents=True, exist_ok=True)
        (findings / f"{name}.bin").write_bytes(data)
        (findings / f"{name}.txt").write_text(f"{finding.kind}\n{finding.detail}", encoding="utf-8")
        outcome.findings.append(replace(finding, kind=f"{finding.kind} ({name}.bin)"))


def _work(name: str, folder: Path, seconds: float, faults: int, counts: Any, pipe: Connection) -> None:
    import atheris

    from tests.fuzz.corpus import TARGETS
    from tests.fuzz.mutations import MAX_BYTES
    from tests.fuzz.runner import HANG_S, MEMORY_BYTES, TOO_MUCH, judge, peak_bytes, prepare, resident_bytes

    target = TARGETS[name]
    prepare(target, str(folder))
    known: set[str] = set()
    last = (folder / "input").open("w+b", buffering=0)

    def read(data: bytes) -> None:
        last.seek(0)
        last.write(data)
        last.truncate()
        # What is kept for further mutations grows beside what an input takes.
        had, peak = resident_bytes(), peak_bytes()
        signal.setitimer(signal.ITIMER_PROF, HANG_S)
        finding = judge(target, data, 0, counts)
        signal.setitimer(signal.ITIMER_PROF, 0)
        counts[0] += 1
        if finding and finding.kind not in known:
            known.add(finding.kind)
            pipe.send((finding, data))
            if len(known) >= faults:
                os._exit(0)
        if peak < peak_bytes() > had + MEMORY_BYTES:
            os._exit(TOO_MUCH)

    def mutate(data: bytes, most: int, seed: int) -> bytes:
        """This package's own mutations, which know numbers, words and containers, and now and then libFuzzer's."""
        rng = random.Random(seed)
        if rng.random() < 0.75:
            # What was mutated before may be no container any more, in which its contents could be mutated.
            with contextlib.suppress(Exception):
                return rng.choice(target.mutations)(rng, data)[:most]
        return bytes(atheris.Mutate(data, most))

    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    arguments = [
        name,
        str(folder / "kept"),
        f"-max_total_time={int(seconds)}",
        f"-max_len={MAX_BYTES}",
        "-timeout=100000",
        "-len_control=0",
        "-mutate_depth=2",
        "-reduce_inputs=0",
    ]
    quiet = ["-rss_limit_mb=0", "-handle_segv=0", "-handle_bus=0", "-handle_abrt=0", "-handle_ill=0", "-handle_fpe=0"]
    atheris.Setup([*arguments, *quiet], read, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())
