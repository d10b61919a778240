"""Kills `retarget convert` at random moments, many times: `python killing.py FOLDER RECORDING KILLS SEED`.

Imports and warms up once, then forks: each child is a batch over the recordings that lacks only the seconds of its start. After each kill
every output that exists is read; whatever else lies in the folder is counted as left over. Prints a JSON object with what it found.
"""

from __future__ import annotations

import json
import math
import os
import random
import shutil
import signal
import sys
import time
from pathlib import Path

from retarget import formats
from retarget.cli.main import cli

CLIPS = 4
OUTPUTS = (("mcap", ".mcap"), ("csv", ".csv"), ("hdf5", ".h5"), ("npz", ".npz"), ("rosbag2", "_bag"))


def convert(folder: Path, name: str, suffix: str) -> int:
    """Exit code of a batch over all clips into the format `name`, leaving what is finished."""
    inputs = [str(folder / f"clip{i}.mvnx") for i in range(CLIPS)]
    output = ["-o", str(folder / "out" / ("{stem}" + suffix)), "--format", name]
    try:
        cli.main(["convert", *inputs, "--robot", "g1", "--skip-existing", "-q", *output], standalone_mode=False)
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def main(folder: Path, recording: Path, kills: int, seed: int) -> dict[str, int]:
    """Counts: kills, those that hit a batch at work, outputs read complete, and what was left over or broken."""
    chance = random.Random(seed)
    (folder / "out").mkdir(parents=True)
    for i in range(CLIPS):
        shutil.copy(recording, folder / f"clip{i}.mvnx")
    batch_s = math.inf
    for name, suffix in OUTPUTS:
        begun = time.perf_counter()
        convert(folder, name, suffix)
        # The first includes imports and the robot's model; later ones what a child will take.
        batch_s = min(batch_s, time.perf_counter() - begun)
        shutil.rmtree(folder / "out")
        (folder / "out").mkdir()
    counts = dict.fromkeys(("kills", "at_work", "complete", "broken", "left_over", "finished_batches"), 0)
    known: set[Path] = set()
    while counts["kills"] < kills:
        name, suffix = OUTPUTS[counts["finished_batches"] % len(OUTPUTS)]
        child = os.fork()
        if child == 0:
            os._exit(convert(folder, name, suffix))
        time.sleep(chance.uniform(0, batch_s))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        counts["kills"] += 1
        counts["at_work"] += os.WIFSIGNALED(status)
        for path in (folder / "out").iterdir():
            if path.name.startswith(".retarget-"):
                # Only formats that are folders may leave something, hidden.
                counts["left_over"] += name != "rosbag2"
                shutil.rmtree(path) if path.is_dir() else path.unlink()
            elif path not in known:
                known.add(path)
                try:
                    assert formats.read_trajectory(path).frames > 0
                    counts["complete"] += 1
                except Exception as error:
                    print(f"{path}: {error}", file=sys.stderr)
                    counts["broken"] += 1
        if len(known) == CLIPS:
            counts["finished_batches"] += 1
            known.clear()
            shutil.rmtree(folder / "out")
            (folder / "out").mkdir()
    # The rest is finished by the same command.
    name, suffix = OUTPUTS[counts["finished_batches"] % len(OUTPUTS)]
    assert convert(folder, name, suffix) == 0
    outputs = sorted(path.name for path in (folder / "out").iterdir())
    assert outputs == [f"clip{i}{suffix}" for i in range(CLIPS)], outputs
    return counts


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))))
