"""A LeRobot dataset, version 3.0, of one episode: a folder, for policies trained with LeRobot and tools that read its datasets.

| file | holds |
|---|---|
| `meta/info.json` | version, robot, frames per second, features with their shapes and names |
| `meta/stats.json`, `meta/tasks.parquet`, `meta/episodes/chunk-000/file-000.parquet` | statistics, the one task's text, the one episode |
| `data/chunk-000/file-000.parquet` | a row a frame, of the features below |
| `meta/retarget.json` | ours: schema, first time, kind and name of the base, provenance, URDF |

| feature | shape | holds |
|---|---|---|
| `observation.state` | (n,) | joint positions in rad, in the robot's own order (that of its URDF), named |
| `observation.velocity` | (n,) | joint velocities in rad/s |
| `observation.base_pose` | (7,) | with a moving base: world ← base link, x y z in m, quaternion **xyzw**, each named |
| `observation.base_twist` | (6,) | its linear and angular velocity, world, m/s and rad/s, where both are known |
| `status` | (1,) | 0 = solved, 1 = marked |
| `action` | (n,) | what a position controller is told: the joint positions of the same frame |
| `timestamp frame_index episode_index index task_index` | (1,) | LeRobot's own |

Numbers are float32, as LeRobot has them: values come back within 6e-8 of their size. Frames must be evenly spaced within 0.1 ms, LeRobot's own
tolerance, at a whole number a second (`--rate` resamples); frame k comes back at its first time + k / fps. There are no videos.

The layout is that of LeRobot's `src/lerobot/datasets` (github.com/huggingface/lerobot: `utils.py`, `io_utils.py`, `dataset_metadata.py`).
Many clips make one dataset by LeRobot's own `lerobot-edit-dataset` (merge). Datasets of others are read when they hold one episode with a named
`observation.state` in rad. There is no suffix: name the format (`--format lerobot -o walk_dataset`); `--force` replaces a folder only where all in it was written here.
Needs the extra `lerobot` (pyarrow).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import FormatError, RetargetError, UsageError
from retarget.core.field_checks import LARGEST_ARRAY_BYTES
from retarget.core.types import Array, HumanMotion, JointTrajectory
from retarget.formats import _headerless, _parquet_count, _trajectory
from retarget.formats._folders import holds_only
from retarget.formats.base import Format, TrajectoryOptions

VERSION = "v3.0"
INFO, STATS, TASKS, OURS = "meta/info.json", "meta/stats.json", "meta/tasks.parquet", "meta/retarget.json"
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES_PATH = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
STATE, VELOCITY, ACTION = "observation.state", "observation.velocity", "action"
POSE, TWIST, STATUS = "observation.base_pose", "observation.base_twist", "status"
POSE_NAMES = ["x", "y", "z", "qx", "qy", "qz", "qw"]
TWIST_NAMES = ["vx", "vy", "vz", "wx", "wy", "wz"]
TOLERANCE_S = 1e-4
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_LARGEST_JSON = 64 << 20
_LARGEST_COUNT = LARGEST_ARRAY_BYTES // 4 // 8
"""Of numbers in all columns together: 6 hours of 30 joints at 100 Hz."""


def write_folder(folder: Path, trajectory: JointTrajectory, _style: str, _motion: HumanMotion | None = None) -> None:
    """Write a dataset's files into the empty `folder`.

    Raises `UsageError` without pyarrow, `RetargetError` for unevenly spaced frames and values that float32 can't hold.
    """
    pa, pq = _pyarrow()
    fps = _fps(trajectory)
    columns, names = _columns(trajectory, fps)
    stats = {name: _statistics(values) for name, values in columns.items()}
    task = f"Follow the recorded motion ({trajectory.robot or 'robot'})."
    count = trajectory.frames
    own = {
        "schema": _trajectory.SCHEMA,
        "start_s": float(trajectory.time[0]),
        "base": "fixed" if trajectory.base_position is None else "floating",
        "base_frame": trajectory.base_frame,
        "joint_names": trajectory.joint_names,
        "provenance": json.loads(_trajectory.provenance_json(trajectory)),
        "robot_description": trajectory.robot_description,
    }
    info = {
        "codebase_version": VERSION,
        "robot_type": trajectory.robot or None,
        "total_episodes": 1,
        "total_frames": count,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": "0:1"},
        "data_path": DATA_PATH,
        "video_path": None,
        "features": {
            name: {"dtype": str(values.dtype), "shape": [values.shape[1]], "names": names.get(name)}
            for name, values in columns.items()
        },
    }
    episode: dict[str, Any] = {
        "episode_index": [0],
        "tasks": [[task]],
        "length": [count],
        "data/chunk_index": [0],
        "data/file_index": [0],
        "dataset_from_index": [0],
        "dataset_to_index": [count],
        "meta/episodes/chunk_index": [0],
        "meta/episodes/file_index": [0],
    }
    episode |= {f"stats/{name}/{key}": [values] for name, found in stats.items() for key, values in found.items()}
    files = {
        DATA_PATH.format(chunk_index=0, file_index=0): pa.table({k: _arrow(pa, v) for k, v in columns.items()}),
        EPISODES_PATH.format(chunk_index=0, file_index=0): pa.table(episode),
        TASKS: _tasks(pa, task),
    }
    for path, table in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        with (folder / path).open("xb") as stream:
            pq.write_table(table, stream, compression="snappy")
    for path, value in ((INFO, info), (STATS, stats), (OURS, own)):
        text = json.dumps(value, indent=4, ensure_ascii=False, allow_nan=False)
        (folder / path).write_text(text, encoding="utf-8")


def _fps(trajectory: JointTrajectory) -> int:
    if trajectory.frames < 2:
        return 1
    fps = max(1, round(trajectory.rate_hz))
    even = trajectory.time[0] + np.arange(trajectory.frames) / fps
    off = np.abs(trajectory.time - even)
    if off.max() > TOLERANCE_S:
        frame = int(np.argmax(off > TOLERANCE_S))
        raise RetargetError(
            f"lerobot: frame {frame} is {1e3 * off[frame]:.3g} ms off its place at {fps} frames/s; expected evenly spaced frames, a "
            "whole number a second (--rate resamples)"
        )
    return fps


def _columns(trajectory: JointTrajectory, fps: int) -> tuple[dict[str, NDArray[Any]], dict[str, list[str]]]:
    """Arrays (T, k) by feature, and the names of their components."""
    joints, frame = list(trajectory.joint_names), np.arange(trajectory.frames)[:, None]
    if not joints:
        raise RetargetError("lerobot: the trajectory has no joints; expected at least one")
    columns: dict[str, NDArray[Any]] = {STATE: trajectory.position, VELOCITY: trajectory.velocity}
    names = {STATE: joints, VELOCITY: joints, ACTION: joints, POSE: POSE_NAMES, TWIST: TWIST_NAMES}
    position, quaternion = trajectory.base_position, trajectory.base_orientation
    if position is not None and quaternion is not None:
        columns[POSE] = np.hstack([position, quaternion[:, [1, 2, 3, 0]]])
    linear, angular = trajectory.base_linear_velocity, trajectory.base_angular_velocity
    if linear is not None and angular is not None:
        columns[TWIST] = np.hstack([linear, angular])
    columns[ACTION] = trajectory.position
    for name, values in columns.items():
        with np.errstate(over="ignore"):
            columns[name] = values.astype(np.float32)
        if not np.isfinite(columns[name]).all():
            raise RetargetError(f"lerobot: {name} holds {np.abs(values).max():g}; expected what float32 can hold")
    columns[STATUS] = trajectory.status.astype(np.int64)[:, None]
    columns["timestamp"] = (frame / fps).astype(np.float32)
    columns |= {"frame_index": frame, "episode_index": 0 * frame, "index": frame, "task_index": 0 * frame}
    return columns, {name: names[name] for name in columns if name in names}


def _statistics(values: NDArray[Any]) -> dict[str, list[float] | list[int]]:
    numbers = values.astype(float)
    found: dict[str, list[float] | list[int]] = {
        "min": numbers.min(axis=0).tolist(),
        "max": numbers.max(axis=0).tolist(),
        "mean": numbers.mean(axis=0).tolist(),
        "std": numbers.std(axis=0).tolist(),
        "count": [len(values)],
    }
    return found | {key: np.quantile(numbers, level, axis=0).tolist() for key, level in _QUANTILES.items()}


def _arrow(pa: Any, values: NDArray[Any]) -> Any:
    """(T, k) as a column of fixed-size lists, of plain numbers where k is 1: what LeRobot's features of those shapes are."""
    flat = pa.array(np.ascontiguousarray(values).ravel())
    return flat if values.shape[1] == 1 else pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _tasks(pa: Any, task: str) -> Any:
    """The table of tasks, with the note by which pandas takes the text as its index: LeRobot looks tasks up in that."""
    note = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            {
                "name": "task_index",
                "field_name": "task_index",
                "pandas_type": "int64",
                "numpy_type": "int64",
                "metadata": None,
            },
            {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object", "metadata": None},
        ],
        "pandas_version": "2.0.0",
    }
    table = pa.table({"task_index": pa.array([0], pa.int64()), "task": [task]})
    return table.replace_schema_metadata({"pandas": json.dumps(note)})


def recognises_folder(folder: Path) -> bool:
    """Whether there is a dataset's description in `folder`."""
    return (folder / INFO).is_file()


def is_own_folder(folder: Path) -> bool:
    """Whether `folder` holds a dataset written here, and nothing else."""
    data, episodes = (path.format(chunk_index=0, file_index=0) for path in (DATA_PATH, EPISODES_PATH))
    return (folder / OURS).is_file() and holds_only(folder, (INFO, STATS, TASKS, OURS, data, episodes))


def read_folder(folder: Path, name: str, options: TrajectoryOptions | None = None) -> JointTrajectory:
    """The trajectory in a dataset of one episode; see the module.

    options: joint names of a dataset that names none. Raises `UsageError` without pyarrow, `FormatError` for anything else than such a dataset.
    """
    options = options or TrajectoryOptions()
    info = _json(folder, name, INFO)
    version, episodes = str(info.get("codebase_version", "none")), info.get("total_episodes")
    if not version.startswith("v3."):
        raise FormatError(name, f"LeRobot dataset of version {version}", place=INFO, expected=VERSION)
    if episodes != 1:
        raise FormatError(name, f"{episodes} episodes", place=INFO, expected="a dataset of one")
    own = _json(folder, name, OURS) if (folder / OURS).is_file() else {}
    if own:
        _trajectory.check_schema(name, str(own.get("schema")))
    columns = _read_columns(folder, name)
    position = _feature(name, columns, STATE)
    time = _start(name, own) + np.arange(len(position)) / _positive(name, info.get("fps"))
    warnings = []
    if VELOCITY in columns:
        velocity = _feature(name, columns, VELOCITY)
    else:
        velocity = _trajectory.differentiate(time, position)
        warnings.append("velocity missing: differentiated from the positions")
    pose = _feature(name, columns, POSE, 7) if POSE in columns and _names(info, POSE) == POSE_NAMES else None
    twist = _feature(name, columns, TWIST, 6) if TWIST in columns and _names(info, TWIST) == TWIST_NAMES else None
    status = _feature(name, columns, STATUS, 1)[:, 0] if own and STATUS in columns else np.zeros(0)
    quaternion = None if pose is None else _trajectory.unit_quaternions(name, POSE, pose[:, [6, 3, 4, 5]])
    return _trajectory.build(
        name,
        warnings,
        time=time,
        joint_names=_joint_names(name, info, own, position.shape[1], options),
        position=position,
        velocity=velocity,
        base_position=None if pose is None else pose[:, :3],
        base_orientation=quaternion,
        base_linear_velocity=None if twist is None else twist[:, :3],
        base_angular_velocity=None if twist is None else twist[:, 3:],
        status=status,
        base_frame=str(own.get("base_frame", "base_link")),
        robot=str(info.get("robot_type") or ""),
        provenance=own.get("provenance", {}) if isinstance(own.get("provenance", {}), dict) else {},
        robot_description=str(own.get("robot_description", "")),
    )


def _json(folder: Path, name: str, place: str) -> dict[str, Any]:
    with (folder / place).open("rb") as stream:
        data = stream.read(_LARGEST_JSON + 1)
    if len(data) > _LARGEST_JSON:
        raise FormatError(name, f"more than {_LARGEST_JSON >> 20} MiB", place=place, expected="a dataset's description")
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise FormatError(name, f"not UTF-8 text: {error.reason}", place=place) from error
    value = _trajectory.parse_json(name, place, text)
    if not isinstance(value, dict):
        raise FormatError(name, f"found a JSON {type(value).__name__}", place=place, expected="an object")
    return value


def _read_columns(folder: Path, name: str) -> dict[str, NDArray[Any]]:
    """The numeric columns of all data files, (T,) or (T, k)."""
    pa, pq = _pyarrow()
    paths = sorted((folder / "data").glob("*/*.parquet"))
    if not paths:
        raise FormatError(name, "no data/*/*.parquet", expected="the frames of its episode")
    wanted = (STATE, VELOCITY, POSE, TWIST, STATUS)
    try:
        count = _parquet_count.count(paths, wanted)
        if count > _LARGEST_COUNT:
            raise ValueError(f"{count} numbers; expected at most {_LARGEST_COUNT}")
        tables = []
        for path in paths:
            with path.open("rb") as stream:
                file = pq.ParquetFile(stream)
                tables.append(file.read([column for column in file.schema_arrow.names if column in wanted]))
        table = pa.concat_tables(tables)
        return {column: _numbers(pa, table[column]) for column in table.column_names}
    except OSError as error:
        if error.errno is not None:
            raise
        # Damaged Parquet is pyarrow's OSError, without the number that the file system's have.
        raise FormatError(name, f"not readable data: {' '.join(str(error).split())}", place="data") from error
    # pyarrow's errors derive from a dozen of Python's.
    except (pa.ArrowException, ValueError, TypeError, KeyError, OverflowError) as error:
        raise FormatError(name, f"not readable data: {' '.join(str(error).split())}", place="data") from error


def _numbers(pa: Any, column: Any) -> NDArray[Any]:
    """A column of plain numbers (T,), or of lists of one length (T, k); NaN for what is missing. Raises `ValueError` for any other."""
    array = pa.concat_arrays(column.chunks) if column.num_chunks else pa.array([], column.type)
    rows = len(array)
    if is_list := pa.types.is_fixed_size_list(array.type) or pa.types.is_list(array.type):
        lengths = set(array.value_lengths().unique().to_pylist())
        if len(lengths) > 1 or None in lengths:
            raise ValueError("lists of several lengths")
        array = array.flatten()
    if not (pa.types.is_floating(array.type) or pa.types.is_integer(array.type)):
        raise ValueError(f"values of type {array.type}")
    values = np.asarray(array.to_numpy(zero_copy_only=False), float)
    return values.reshape(rows, -1) if is_list and rows else values


def _feature(name: str, columns: Mapping[str, NDArray[Any]], key: str, width: int | None = None) -> Array:
    """Column `key` as (T, k)."""
    if key not in columns:
        raise FormatError(name, f"no feature '{key}'", place="data", expected="joint positions of each frame")
    values = columns[key].reshape(len(columns[key]), -1) if columns[key].size else columns[key]
    if values.ndim != 2 or (width is not None and values.shape[1] != width):
        raise FormatError(name, f"{key} of shape {values.shape}", place="data", expected=f"(T, {width or 'n'})")
    return values


def _names(info: Mapping[str, Any], key: str) -> list[str] | None:
    """Names of a feature's components; datasets of robots' drivers have them one level further down, as {"motors": […]}."""
    features = info.get("features")
    feature = features.get(key) if isinstance(features, dict) else None
    names = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(names, dict) and len(names) == 1:
        names = next(iter(names.values()))
    return names if isinstance(names, list) and all(isinstance(item, str) for item in names) else None


def _joint_names(
    name: str, info: Mapping[str, Any], own: Mapping[str, Any], joints: int, options: TrajectoryOptions
) -> tuple[str, ...]:
    found = _names(info, STATE)
    if found is None or (len(found) != joints and not own):
        if options.joint_names is None:
            raise FormatError(
                name,
                f"{STATE} does not name its {joints} joints",
                place=INFO,
                expected="names; or the robot named, and the order of its joints",
            )
        found = list(options.joint_names)
    _headerless.check_count(name, joints, tuple(found))
    return tuple(found)


_LATEST_S = 1e12
"""No recording starts later, whatever its clock counts from."""


def _start(name: str, own: Mapping[str, Any]) -> float:
    start = own.get("start_s", 0.0)
    if isinstance(start, bool) or not isinstance(start, int | float) or not abs(start) < _LATEST_S:
        raise FormatError(name, f"start_s {str(start)[:40]}", place=OURS, expected="a time in s")
    return float(start)


def _positive(name: str, fps: object) -> float:
    if isinstance(fps, bool) or not isinstance(fps, int | float) or not 0 < fps < 1e6:
        raise FormatError(name, f"fps {fps}", place=INFO, expected="a positive number below a million")
    return float(fps)


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise UsageError(
            "lerobot needs the package pyarrow, which is not installed; expected it from pip install 'retarget[lerobot]'"
        ) from None
    return pyarrow, pyarrow.parquet


FORMAT = Format(
    name="lerobot",
    description="LeRobot dataset v3.0 of one episode, a folder; needs the extra lerobot",
    suffixes=(),
    recognises_folder=recognises_folder,
    is_own_folder=is_own_folder,
    read_folder=read_folder,
    write_folder=write_folder,
)
