"""How many numbers Parquet files stand for, counted from their metadata by a process of its own.

A few bytes may stand for billions of equal numbers, so they are counted before they are unpacked. Damaged metadata of a column can end the process that
looks at it: pyarrow lets a C++ exception of its column's constructor through. In another process that is an exit code.
`python -m retarget.formats._parquet_count` takes JSON, {"files": paths, "columns": names}, on stdin and prints the sum.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

PROCESSOR_S = 10
"""What counting may take: pyarrow needs 0.2 s to start."""


def count(paths: Sequence[Path], columns: Sequence[str]) -> int:
    """Numbers in the `columns` of the Parquet files `paths` together. Raises `ValueError` with the reason where it can't be told."""
    question = json.dumps({"files": [str(path) for path in paths], "columns": list(columns)})
    command = [sys.executable, "-m", "retarget.formats._parquet_count"]
    done = subprocess.run(command, input=question, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode == 0:
        return int(done.stdout)
    reason = done.stderr.strip().rpartition("\n")[2]
    if done.returncode < 0 or not reason:
        reason = f"the Parquet library did not get through it (exit code {done.returncode})"
    raise ValueError(reason)


def main() -> int:
    """Prints the answer to the question on stdin; the reason of a failure goes to stderr."""
    import resource

    import pyarrow.parquet as pq

    resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_S, PROCESSOR_S))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    question = json.load(sys.stdin)
    try:
        print(sum(_count(pq.read_metadata(path), question["columns"]) for path in question["files"]))
    # pyarrow's errors derive from a dozen of Python's.
    except Exception as error:
        print(" ".join(str(error).split()) or type(error).__name__, file=sys.stderr)
        return 1
    return 0


def _count(metadata: object, wanted: Sequence[str]) -> int:
    import pyarrow.parquet as pq

    assert isinstance(metadata, pq.FileMetaData)
    groups = (metadata.row_group(i) for i in range(metadata.num_row_groups))
    columns = (group.column(i) for group in groups for i in range(group.num_columns))
    return sum(int(column.num_values) for column in columns if _top(column.path_in_schema, wanted))


def _top(path: str, wanted: Sequence[str]) -> bool:
    """Whether a column of plain numbers or of lists, which have a path below the feature's name, is one of `wanted`."""
    return any(path == name or path.startswith(f"{name}.list.") for name in wanted)


if __name__ == "__main__":
    sys.exit(main())
