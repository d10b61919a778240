"""Compiled models on disk, under the hash of all they were made from: a robot whose meshes take a second to prepare loads in milliseconds."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import mujoco

NAME = "model.mjb"
DIGEST_BYTES = hashlib.sha256().digest_size
"""A stored model ends with the hash of what stands before."""

LARGEST_FOLDER_BYTES = 1_000_000_000
"""Beyond it the models that were not used for longest are deleted."""


def default_folder() -> Path | None:
    """`$XDG_CACHE_HOME/retarget`, else `~/.cache/retarget`; where these can't be written a private temporary folder; None if that can't either."""
    home = os.environ.get("XDG_CACHE_HOME", "")
    with contextlib.suppress(RuntimeError):  # no home folder at all
        base = Path(home) if Path(home).is_absolute() else Path.home() / ".cache"
        if _is_private(base / "retarget"):
            return base / "retarget"
    temporary = Path(tempfile.gettempdir()) / f"retarget-{os.getuid()}"
    return temporary if _is_private(temporary) else None


def _is_private(folder: Path) -> bool:
    """Whether the folder could be made, is ours, and is writable: models are loaded from it, so nobody else may put some there."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
    except OSError:
        return False
    return status.st_uid == os.getuid() and not status.st_mode & 0o022 and os.access(folder, os.W_OK)


def key_of(parts: Iterable[bytes | str]) -> str:
    """Hash of everything that decides what the model is: `parts`, MuJoCo's version and the code of this folder."""
    digest = hashlib.sha256()
    code = [path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py"))]
    for part in (mujoco.__version__, *code, *parts):
        raw = part.encode() if isinstance(part, str) else part
        digest.update(len(raw).to_bytes(8, "little"))
        digest.update(raw)
    return digest.hexdigest()


def load(folder: Path | None, key: str) -> Any | None:
    """The model stored under `key`, or None. A file that can't be read is as good as none."""
    path = None if folder is None else folder / f"{key}.mjb"
    if path is None or not path.is_file():
        return None
    try:
        data = path.read_bytes()
        # MuJoCo aborts on, and logs into the working folder, what isn't a whole model: it gets to see only what was stored whole.
        if hashlib.sha256(data[:-DIGEST_BYTES]).digest() != data[-DIGEST_BYTES:]:
            return None
        model = mujoco.MjModel.from_binary_path(NAME, {NAME: data[:-DIGEST_BYTES]})
    except (OSError, ValueError, RuntimeError, mujoco.FatalError):
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return model


def store(folder: Path | None, key: str, mj: Any) -> None:
    """Keeps the model. Failing to is no failure: it is only slower next time."""
    if folder is None:
        return
    temporary = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=folder, suffix=".tmp")
        os.close(handle)
        temporary = Path(name)
        mujoco.mj_saveModel(mj, name, None)
        with temporary.open("r+b") as file:
            digest = hashlib.file_digest(file, "sha256").digest()
            file.write(digest)  # after the last byte read
        temporary.replace(folder / f"{key}.mjb")
        _make_room(folder, folder / f"{key}.mjb")
    except (OSError, RuntimeError, ValueError, mujoco.FatalError):
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def _make_room(folder: Path, keep: Path) -> None:
    models = sorted(((path.stat(), path) for path in folder.glob("*.mjb")), key=lambda item: -item[0].st_mtime)
    total = 0
    for status, path in models:
        total += status.st_size
        if total > LARGEST_FOLDER_BYTES and path != keep:
            path.unlink(missing_ok=True)
