"""metadata.yaml of rosbag2 folders: which files hold the messages, and how. Nothing else of it is needed, and nothing of it is believed.

The text may be anybody's: it is short, plain data without tags, and names files of its own folder only.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from retarget.core.errors import FormatError

METADATA = "metadata.yaml"
NEWEST = 9
"""Version of the layout: of the parts read here the same since the first."""
_LARGEST = 1 << 20
_DEEPEST = 50
_OPENING, _CLOSING = list(b"[{"), list(b"]}")
Storage = Literal["mcap", "sqlite3"]
Compression = Literal["", "file", "message"]


@dataclass(frozen=True)
class Bag:
    """Storage files in the order of the recording, each packed as a whole by zstd ("file"), or message by message, or not at all."""

    files: list[Path]
    storage: Storage
    compression: Compression


def load(folder: Path, name: str) -> Bag:
    """What the metadata in `folder` says. Raises `FormatError` for metadata of no bag and files that are missing."""
    information = _information(folder, name)
    version = information.get("version", NEWEST)
    if not isinstance(version, int) or not 1 <= version <= NEWEST:
        raise FormatError(name, f"rosbag2 version {version}", place=METADATA, expected=f"1 to {NEWEST}")
    storage = information.get("storage_identifier")
    if storage not in ("mcap", "sqlite3"):
        raise FormatError(name, f"storage_identifier {storage!r}", place=METADATA, expected="mcap or sqlite3")
    mode = str(information.get("compression_mode") or "").lower()
    mode = "" if mode == "none" else mode
    if mode not in ("", "file", "message"):
        raise FormatError(name, f"compression_mode '{mode}'", place=METADATA, expected="file, message or none")
    if mode and (kind := information.get("compression_format")) != "zstd":
        raise FormatError(name, f"compression_format {kind!r}", place=METADATA, expected="zstd")
    return Bag(_storage_files(folder, name, information), cast(Storage, storage), cast(Compression, mode))


def _information(folder: Path, name: str) -> dict[str, Any]:
    from ruamel.yaml.error import YAMLError

    with (folder / METADATA).open("rb") as stream:
        text = stream.read(_LARGEST + 1)
    if len(text) > _LARGEST:
        raise FormatError(name, f"{METADATA} of more than {_LARGEST >> 20} MiB", expected="a bag's metadata")
    # The parser takes seconds over thousands of open brackets.
    bytes_ = np.frombuffer(text, np.uint8)
    if len(text) and np.cumsum(np.isin(bytes_, _OPENING) * 1 - np.isin(bytes_, _CLOSING)).max() > _DEEPEST:
        raise FormatError(
            name, "brackets within brackets", place=METADATA, expected="the metadata of a rosbag2 recording"
        )
    try:
        found = _parsed(text.decode())["rosbag2_bagfile_information"]
    except YAMLError as error:
        raise FormatError(name, f"not YAML: {' '.join(str(error).split())}", place=METADATA) from error
    # Nesting beyond Python's depth, other types than mappings, text that is none: the loader's and ours.
    except (KeyError, TypeError, ValueError, RecursionError, AttributeError) as error:
        problem = f"no rosbag2_bagfile_information: {type(error).__name__}"
        raise FormatError(name, problem, place=METADATA, expected="the metadata of a rosbag2 recording") from error
    if not isinstance(found, dict):
        raise FormatError(name, "rosbag2_bagfile_information is no mapping", place=METADATA)
    return found


def _parsed(text: str) -> Any:
    from ruamel.yaml import YAML
    from ruamel.yaml.constructor import ConstructorError, SafeConstructor

    class WithoutMerging(SafeConstructor):
        """Merged mappings ("<<: [*a, *a]") of merged mappings grow with the power of their depth."""

        def flatten_mapping(self, node: Any) -> Any:
            for key, _ in node.value:
                if key.tag == "tag:yaml.org,2002:merge":
                    raise ConstructorError(None, None, "found a merge key", key.start_mark)
            return super().flatten_mapping(node)

    yaml = YAML(typ="safe", pure=True)
    yaml.Constructor = WithoutMerging
    return yaml.load(text)


def _storage_files(folder: Path, name: str, information: dict[str, Any]) -> list[Path]:
    """The bag's files. Only names count: bags before version 4 put their folder's before, and nothing outside the folder is read."""
    listed = information.get("relative_file_paths")
    if not isinstance(listed, list) or not listed or not all(isinstance(item, str) for item in listed):
        raise FormatError(name, "no relative_file_paths", place=METADATA, expected="the names of the bag's files")
    names = [Path(item).name for item in listed]
    if len(set(names)) < len(names):
        raise FormatError(name, "relative_file_paths names a file twice", place=METADATA, expected="each file once")
    paths = [folder / item for item in names]
    for path in paths:
        if not path.is_file():
            raise FormatError(name, f"file {path.name} is missing", place=METADATA)
    return paths
