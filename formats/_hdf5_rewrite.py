"""HDF5 files without checksums, rewritten with them by a process of its own.

Where metadata or texts carry no checksums, a damaged byte can make the HDF5 library loop for ever, ask for gigabytes, or crash. None of
that can be caught in this process; in another it is one of three exit codes. `python -m retarget.formats._hdf5_rewrite` takes a file on
stdin and gives on stdout what a trajectory needs of it: numbers as they are, texts of fixed length.
"""

from __future__ import annotations

import io
import subprocess
import sys
from typing import BinaryIO

from retarget.core.errors import FormatError
from retarget.core.field_checks import LARGEST_ARRAY_BYTES

LARGEST_BYTES = 1 << 30
"""Of a file that is rewritten: it is held in memory by both processes."""
PROCESSOR_S = 2.0
"""What reading any file may take, besides a second for each `BYTES_A_SECOND` of it."""
BYTES_A_SECOND = 50e6
_DEPTH = 2
_LONGEST_TEXT = 16 << 20


def rewritten(stream: BinaryIO, name: str) -> BinaryIO:
    """The rest of `stream` with checksums. Raises `FormatError` where it can't be read."""
    data = stream.read(LARGEST_BYTES + 1)
    if len(data) > LARGEST_BYTES:
        raise FormatError(
            name, f"an HDF5 file without checksums of more than {LARGEST_BYTES >> 20} MB", expected="libver='latest'"
        )
    seconds = PROCESSOR_S + len(data) / BYTES_A_SECOND
    command = [sys.executable, "-m", "retarget.formats._hdf5_rewrite", repr(seconds)]
    done = subprocess.run(command, input=data, capture_output=True, check=False)
    if done.returncode == 0:
        return io.BytesIO(done.stdout)
    reason = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
    if done.returncode < 0 or not reason:
        reason = f"the HDF5 library did not get through it (exit code {done.returncode})"
    raise FormatError(name, f"not a readable HDF5 file: {reason}")


def main() -> int:
    """Rewrites stdin to stdout within the processor time of the first argument, in s; the reason of a failure goes to stderr."""
    import resource

    import h5py
    import numpy as np

    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(np.ceil(used.ru_utime + used.ru_stime + float(sys.argv[1])))
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    resource.setrlimit(resource.RLIMIT_AS, (LARGEST_ARRAY_BYTES, resource.RLIM_INFINITY))
    out = io.BytesIO()
    try:
        with (
            h5py.File(io.BytesIO(sys.stdin.buffer.read()), "r") as old,
            h5py.File(out, "w", libver=("v108", "v110")) as new,
        ):
            _copy_attributes(old, new)
            _copy_datasets(old, new, _DEPTH)
    # The library reports damage as whatever class fits the place where it stumbles.
    except Exception as error:
        print(" ".join(str(error).split()) or type(error).__name__, file=sys.stderr)
        return 1
    sys.stdout.buffer.write(out.getbuffer())
    return 0


def _copy_attributes(old: object, new: object) -> None:
    import h5py
    import numpy as np

    assert isinstance(old, h5py.File)
    assert isinstance(new, h5py.File)
    for key in old.attrs:
        value = old.attrs[key]
        texts = np.asarray(value, object).ravel()
        if not all(isinstance(text, str | bytes) for text in texts):
            new.attrs[key] = value
            continue
        encoded = [text.encode("utf-8", "surrogateescape") if isinstance(text, str) else text for text in texts]
        longest = max(map(len, encoded), default=0)
        if longest * len(encoded) > _LONGEST_TEXT:
            raise ValueError(f"attribute {key} is longer than {_LONGEST_TEXT >> 20} MB")
        flat = np.array(encoded, f"S{max(1, longest)}")
        new.attrs.create(key, flat.reshape(np.shape(value)), dtype=h5py.string_dtype("utf-8", max(1, longest)))


def _copy_datasets(old: object, new: object, depth: int) -> None:
    import h5py

    assert isinstance(old, h5py.Group)
    assert isinstance(new, h5py.Group)
    for key in old:
        item = old.get(key)
        if isinstance(item, h5py.Group) and depth > 1:
            _copy_datasets(item, new.require_group(key), depth - 1)
        elif isinstance(item, h5py.Dataset):
            size = item.size * item.dtype.itemsize if item.size else 0
            if size > LARGEST_ARRAY_BYTES // 4:
                raise ValueError(f"an array of {size >> 20} MB in {item.name}")
            if item.dtype.kind in "fiub":
                new.create_dataset(key, data=item[()])
            else:
                new.create_dataset(key, data=0.0)  # of a kind that is refused by its shape


if __name__ == "__main__":
    sys.exit(main())
