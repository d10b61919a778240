"""`python -m tests.fuzz --reader mvnx --seconds 1800`: fuzz readers for as long as there is time.

Without `--reader` all of them, one after the other. Inputs that failed are written to `--findings`. Exit code 1 when there are some.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tests.fuzz.corpus import TARGETS
from tests.fuzz.runner import minimal_report, mutated, run


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.partition("\n")[0])
    parser.add_argument("--reader", action="append", choices=TARGETS, help="repeat for several [default: all]")
    parser.add_argument("--seconds", type=float, default=1800.0, help="for each reader [default: 1800]")
    parser.add_argument("--count", type=int, default=1_000_000, help="inputs for each reader [default: 1,000,000]")
    parser.add_argument("--first", type=int, default=0, help="index of the first input [default: 0]")
    parser.add_argument("--findings", type=Path, help="folder for inputs that failed")
    chosen = parser.parse_args()
    bad = False
    for name in chosen.reader or TARGETS:
        outcome = run(name, count=chosen.count, seconds=chosen.seconds, first=chosen.first)
        print("\n".join(minimal_report(outcome)), flush=True)
        bad = bad or bool(outcome.findings)
        if chosen.findings and outcome.findings:
            chosen.findings.mkdir(parents=True, exist_ok=True)
            seeds = list(TARGETS[name].seeds())
            for finding in outcome.findings:
                data = mutated(TARGETS[name], seeds, finding.index)
                (chosen.findings / f"{name}-{finding.index}.bin").write_bytes(data)
                (chosen.findings / f"{name}-{finding.index}.txt").write_text(f"{finding.kind}\n{finding.detail}")
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
