"""Messages whose definition the recording or the user has to bring: `LinkStateArray` of the Xsens drivers.

MCAP, ROS 1 bags and newer `.db3` hold the definition of every type. Older `.db3` name the type only: its `.msg` files, or the folder
they are in (the driver's own), are given as `msg_defs`. The standard messages that definitions refer to are known.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from retarget.core.errors import FormatError, RetargetError, UsageError, nearest
from retarget.formats._ros_wire import Pose

_LARGEST_DEFINITION = 1 << 20
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(?:/msg)?/[A-Za-z]\w*", re.ASCII)
_FIELD_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
_LONGEST_ARRAY = 1 << 20
_MOST_LINES = 1000


class Definition:
    """One message type with a decoder for it.

    message_type: `package/Name`. text: its definition as the recording holds it, `encoding` "ros1msg", "ros2msg" or "ros2idl"; "" = none.
    Raises `FormatError` where neither the recording nor `msg_defs` defines it, `UsageError` for `msg_defs` that can't be used.
    """

    def __init__(
        self,
        file: str,
        topic: str,
        message_type: str,
        text: str,
        encoding: str,
        *,
        ros1: bool,
        msg_defs: Sequence[Path],
    ) -> None:
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

        self.file, self.topic, self.ros1 = file, topic, ros1
        package, _, self.name = message_type.partition("/")
        self.full_name = f"{package}/msg/{self.name}"
        self._store: Any = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        types: dict[str, Any] = {}
        try:
            if text:
                types = get_types_from_idl(text) if encoding == "ros2idl" else get_types_from_msg(text, self.full_name)
            else:
                for path in definition_files(msg_defs):
                    # Files of one package refer to each other by bare names; a file that is alone is taken for the bag's package.
                    own = path.parent.parent.name if path.parent.name == "msg" else package
                    content = path.read_text(encoding="utf-8-sig")
                    for owner in dict.fromkeys((package, own)):
                        types |= get_types_from_msg(content, f"{owner}/msg/{path.stem}")
            new = {name: fields for name, fields in types.items() if name not in self._store.fielddefs}
            check(new)
            self._store.register(new)
            known = self.full_name in self._store.fielddefs
            if known:
                self._fields_of(self.full_name, (), {})  # finds types that nobody defines
                self._store.get_msgdef(self.full_name)
        except RetargetError:
            raise
        # rosbags' parser reports what it can't read by several errors of its own and by whatever it trips over.
        except Exception as error:
            if isinstance(error, KeyError):
                error = KeyError(f"it refers to {error.args[0]}, which is not defined")
            what = "the recording's definition" if text else "--msg-def"
            lines = str(error.args[0] if error.args else "").strip().splitlines() or [type(error).__name__]
            raise FormatError(
                file, f"{what} of {message_type} can't be read: {lines[0]}", place=f"topic {topic}"
            ) from error
        if not known:
            have = sorted({path.stem for path in definition_files(msg_defs)})
            near = nearest(self.name, have)
            hint = f"; --msg-def holds {', '.join(near or have[:5])}" if have else ""
            raise FormatError(
                file,
                f"unknown message definition {message_type}{hint}",
                place=f"topic {topic}",
                expected=f"--msg-def FOLDER with {self.name}.msg, as this recording holds no definitions",
            )

    def _fields_of(self, name: str, above: tuple[str, ...], known: dict[str, int]) -> int:
        """Number of fields of `name`. Raises `ValueError` for parts that are empty: a few bytes may announce billions of them."""
        from rosbags.interfaces import Nodetype

        if name in above:
            raise ValueError(f"{name} holds itself")
        if name not in known:
            total = 0
            for field, (kind, detail) in self._store.fielddefs[name][1]:
                inner_kind, inner = detail[0] if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (kind, detail)
                size = self._fields_of(inner, (*above, name), known) if inner_kind == Nodetype.NAME else 1
                if not size:
                    raise ValueError(f"{field} of {name} is of {inner}, which holds nothing")
                total += field != "structure_needs_at_least_one_member"
            known[name] = total
        return known[name]

    def links(self, payload: bytes | memoryview) -> Iterator[Pose]:
        """The links of a `LinkStateArray`: `header.frame_id` of each state is the link itself, its pose is in the world.

        Raises `ValueError` for bytes that are no such message, `FormatError` for a definition that is another.
        """
        decode = self._store.deserialize_ros1 if self.ros1 else self._store.deserialize_cdr
        try:
            message = decode(bytes(payload), self.full_name)
            whole = getattr(message, "header", None)
            for state in message.states:
                p, q = state.pose.position, state.pose.orientation
                stamp = state.header.stamp
                if whole is not None and not (stamp.sec or stamp.nanosec):
                    stamp = whole.stamp
                yield Pose(
                    "",
                    state.header.frame_id,
                    stamp.sec * 1_000_000_000 + stamp.nanosec,
                    (p.x, p.y, p.z, q.x, q.y, q.z, q.w),
                )
        except AttributeError as error:
            raise FormatError(
                self.file,
                f"{self.full_name} is not defined as the Xsens drivers do: {error}",
                place=f"topic {self.topic}",
                expected="states[] with header and pose",
            ) from error
        # A wrong length surfaces as whatever the generated decoder trips over first.
        except Exception as error:
            raise ValueError(str(error) or type(error).__name__) from error


def check(types: Mapping[str, Any]) -> None:
    """Raise `ValueError` for definitions that rosbags, which makes Python code of them, must not see.

    Names stand in that code as they are, and fixed arrays of texts or messages become as many lines.
    """
    from rosbags.interfaces import Nodetype

    lines = 0
    for name, (_, fields) in types.items():
        _check_name(_TYPE_NAME, name)
        for field, (kind, detail) in fields:
            _check_name(_FIELD_NAME, field)
            inner_kind, inner = detail[0] if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (kind, detail)
            if inner_kind == Nodetype.NAME:
                _check_name(_TYPE_NAME, inner)
            if kind == Nodetype.ARRAY:
                lines += detail[1] if inner_kind == Nodetype.NAME or inner[0] == "string" else 0
                if detail[1] > _LONGEST_ARRAY or lines > _MOST_LINES:
                    raise ValueError(f"{field} of {name} is a fixed array of {min(detail[1], 10**12)}")


def _check_name(pattern: re.Pattern[str], name: str) -> None:
    if not pattern.fullmatch(name):
        raise ValueError(f"found {name[:100]!r} where a name belongs")


def definition_files(paths: Sequence[Path]) -> list[Path]:
    """The `.msg` files that `paths`, files and folders, mean, sorted within each. Raises `UsageError` for what is not there, or too large."""
    found: list[Path] = []
    for path in paths:
        if path.is_dir():
            below = sorted(path.rglob("*.msg"))
            if not below:
                raise UsageError(f"--msg-def {path}: no .msg file below this folder")
            found += below
        elif path.is_file():
            found.append(path)
        else:
            raise UsageError(f"--msg-def {path}: no such file or folder")
    for path in found:
        if path.stat().st_size > _LARGEST_DEFINITION:
            raise UsageError(f"--msg-def {path}: {path.stat().st_size} bytes; expected a message definition")
    return found
