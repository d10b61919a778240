"""An MVNX document as raw numbers, streamed: XML events in, one array for each wanted field out, nothing interpreted yet.

expat calls back for every tag; characters are asked for only inside a wanted field, and become numbers for a whole chunk of
frames at once. Local names count, prefixes and namespaces do not. Nothing is fetched, no entity is expanded, no schema is asked
(the published one rejects real files).
"""

from __future__ import annotations

import hashlib
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import BinaryIO
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray
from retarget.core.errors import FormatError
from retarget.core.types import Array
from retarget.formats._byte_chunks import read_chunks
from retarget.formats._mvnx_column import Column
from retarget.formats._mvnx_header import MAX_DEPTH, HeaderReader, MvnxHeader, local_name, one_line
from retarget.formats._number_text import RowError

REFERENCE_FRAMES = ("npose", "identity")
"""Frame types that hold the orientations in which a version's segment frames show the T-pose."""

_MAX_TOKEN_BYTES = 16 << 20
_MAX_INDEX = 10**12
_PIECE_BYTES = 50  # what a string needs besides its characters


@dataclass(frozen=True)
class MvnxRecording:
    """A document's content. T normal frames, S segments as labelled in the header.

    index: (T,) the frames' own numbers, strictly increasing. indexed: False when the file has none and they were counted.
    values: field → (T, numbers per frame), as written, NaN rows where a frame lacks the field; only fields that were found, of
    "orientation" (4 S), "position" (3 S), "angularVelocity" (3 S), "footContacts" (one for each defined contact).
    references: frame type → (S, 4) orientations, of `REFERENCE_FRAMES`.
    fields: names of all fields of normal frames, read or not. sha256: of the stream's bytes.
    """

    header: MvnxHeader
    index: NDArray[np.int64]
    indexed: bool
    values: Mapping[str, Array]
    references: Mapping[str, Array]
    fields: tuple[str, ...]
    sha256: str


def parse_mvnx(stream: BinaryIO, name: str) -> MvnxRecording:
    """Read a document from `stream`, which may be gzip. `name` is what messages call it.

    Raises `FormatError`, with the line where there is one.
    """
    digest = hashlib.sha256()
    parser = _Parser(name)
    for chunk in read_chunks(stream, name, digest):
        parser.feed(chunk)
    return parser.finish(digest.hexdigest())


@dataclass(frozen=True)
class MvnxPart:
    """Consecutive frames of a document, with some around them for who has to interpolate.

    recording: the frames that are held, `sha256` "" but in the last part. first: number of its first frame in the document. own: which
    of its frames are the part's; those of all parts together are the document's, each once. index: of all frames so far; is_last.
    """

    recording: MvnxRecording
    first: int
    own: slice
    index: NDArray[np.int64]
    is_last: bool


def parse_mvnx_parts(stream: BinaryIO, name: str, first_s: float, frames: int, around_s: float) -> Iterator[MvnxPart]:
    """As `parse_mvnx`, a part at a time while the document arrives: the first lasts `first_s`, the others hold `frames` frames.

    Where parts end does not depend on how the stream's bytes come. Each holds more than `around_s` of the frames before and after it, as far as
    there are any. Raises `FormatError` as soon as the fault is met.
    """
    digest = hashlib.sha256()
    parser = _Parser(name)
    begin = 0
    for chunk in read_chunks(stream, name, digest, as_it_comes=True):
        parser.feed(chunk)
        while (stop := parser.end_of_part(begin, first_s, frames)) and (held := parser.reach(stop - 1, around_s)):
            low = parser.reach(begin, -around_s) if begin else 0
            assert low is not None
            index = np.array(parser.index[:stop], np.int64)
            yield MvnxPart(parser.part(low, held), low, slice(begin - low, stop - low), index, False)
            begin = stop
            parser.drop(low)
    recording = parser.finish(digest.hexdigest())
    index = np.array(parser.index, np.int64)
    low = len(index) - len(recording.index)
    yield MvnxPart(recording, low, slice(begin - low, len(index) - low), index, True)


class _Parser:
    """The events of one document. Outside `<frames>` they go to a `HeaderReader`, inside to the columns here."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.expat = expat.ParserCreate(intern=None)  # looking names up to share their strings costs more than it saves
        self.expat.buffer_text = False
        self.expat.StartElementHandler = self._start_in_header
        self.expat.EndElementHandler = self._end_in_header
        self.expat.EntityDeclHandler = self._refuse_entity
        self.expat.SkippedEntityHandler = self._refuse_entity
        self.head = HeaderReader(self.expat, self._error)
        self.bytes_fed = 0

        self.wanted: dict[str, dict[str, Column]] = {}  # frame type → local name of a field → its column
        self.met: dict[str, dict[str, Column | None]] = {}  # the same by qualified name, as met so far; None = skip
        self.frame_count: dict[str, int] = {}  # frames begun, by type
        self.index = array("q")  # of normal frames
        self.indexed = True
        self.whole_frames = 0  # normal ones

        self.level = 0  # 0 in <frames>, 1 in <frame>, 2 in a field
        self.frame_type = ""
        self.columns: dict[str, Column | None] | None = (
            None  # those of `met` for the current frame; None = skip the frame
        )
        self.column: Column | None = None  # of the field that is open

    def feed(self, chunk: bytes) -> None:
        """Take the next bytes of the document."""
        self._parse(chunk, final=False)
        self._convert_all()
        self.bytes_fed += len(chunk)
        pieces = self.column.texts if self.column else self.head.text  # of the value that is open
        pending = self.bytes_fed - self.expat.CurrentByteIndex + sum(len(piece) + _PIECE_BYTES for piece in pieces)
        if pending > _MAX_TOKEN_BYTES:
            raise self._error(f"a tag or value longer than {_MAX_TOKEN_BYTES >> 20} MB", "an MVNX document")

    def finish(self, sha256: str) -> MvnxRecording:
        """The recording, after the last chunk."""
        if not self.bytes_fed:
            raise FormatError(self.name, "empty file", expected="an MVNX document")
        self._parse(b"", final=True)
        self._convert_all()
        if not self.wanted:
            raise FormatError(self.name, "no <subject> with <frames>", expected="an MVNX recording")
        if not self.index:
            kinds = [f"{count} {kind or 'without type'}" for kind, count in self.frame_count.items()]
            found = ", ".join(kinds[:5] + ["…"] * (len(kinds) > 5)) or "none"
            raise FormatError(self.name, "no frame of type 'normal'", expected=f"a motion; found frames: {found}")
        normal = self.wanted["normal"].values()
        first = self.wanted["normal"]["orientation"].first
        values = {column.field: column.finish(len(self.index)) for column in normal if column.last >= 0}
        return self._recording(np.array(self.index[first:], np.int64), values, sha256)

    def part(self, first: int, stop: int) -> MvnxRecording:
        """What is known so far, with frames `first` to `stop` - 1, which are whole; `sha256` is not known yet."""
        normal = self.wanted["normal"].values()
        values = {column.field: column.rows(first, stop) for column in normal if column.last >= 0}
        return self._recording(np.array(self.index[first:stop], np.int64), values, "")

    def end_of_part(self, begin: int, first_s: float, frames: int) -> int | None:
        """Number of the frame after the part that starts with `begin`; None where it is not there yet."""
        if begin:
            return begin + frames if begin + frames < self.whole_frames else None
        whole = self.index[: self.whole_frames]
        if not whole or whole[-1] - whole[0] <= first_s * self.head.header.rate_hz:
            return None
        return bisect_right(whole, whole[0] + first_s * self.head.header.rate_hz)

    def reach(self, frame: int, seconds: float) -> int | None:
        """So far from `frame` that more than `seconds` (forward when positive) lie between: the number after that frame, or of it.

        Forward, None where that frame is not whole yet; backward the first that is there.
        """
        at = self.index[frame] + seconds * self.head.header.rate_hz
        if seconds < 0:
            return max(bisect_left(self.index, at) - 1, 0)
        after = bisect_right(self.index, at)
        return after + 1 if after < self.whole_frames else None

    def drop(self, before: int) -> None:
        """Forget the values of normal frames before the number `before`."""
        for column in self.wanted["normal"].values():
            column.drop(before)

    def _recording(self, index: NDArray[np.int64], values: Mapping[str, Array], sha256: str) -> MvnxRecording:
        return MvnxRecording(
            header=self.head.header,
            index=index,
            indexed=self.indexed,
            values=values,
            references={
                kind: self.wanted[kind]["orientation"].finish(1).reshape(-1, 4)
                for kind in REFERENCE_FRAMES
                if kind in self.frame_count
            },
            fields=tuple(dict.fromkeys(map(local_name, self.met["normal"]))),
            sha256=sha256,
        )

    def _parse(self, data: bytes, *, final: bool) -> None:
        try:
            self.expat.Parse(data, final)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            if not self.head.root_seen:
                problem = f"not XML ({reason})"
            elif final:
                problem = f"the document ends early, after {self.whole_frames} whole frames"
            else:
                problem = f"broken XML ({reason}) after {self.whole_frames} whole frames"
            raise FormatError(self.name, problem, place=f"line {error.lineno}", expected="an MVNX document") from None
        except (LookupError, ValueError) as error:
            # pyexpat lets Python's own exception through when it can't make a decoder; all others are ours to see.
            if self.expat.ErrorCode != expat.errors.codes[expat.errors.XML_ERROR_UNKNOWN_ENCODING]:
                raise
            raise FormatError(self.name, f"unknown encoding ({error})", place="line 1", expected="UTF-8") from None

    def _convert_all(self) -> None:
        for kind, columns in self.wanted.items():
            for column in columns.values():
                try:
                    column.convert(self.frame_count.get(kind, 0), open_field=column is self.column)
                except RowError as error:
                    place = f"line {column.lines[error.row]}, {self._frame_name(kind, column.frames[error.row])}"
                    problem = f"{error.problem} in <{column.field}>"
                    raise FormatError(self.name, problem, place=place, expected=column.expected) from None

    def _error(self, problem: str, expected: str) -> FormatError:
        return FormatError(self.name, problem, place=f"line {self.expat.CurrentLineNumber}", expected=expected)

    def _frame_error(self, problem: str, expected: str) -> FormatError:
        frame = self._frame_name(self.frame_type, self.frame_count[self.frame_type] - 1)
        place = f"line {self.expat.CurrentLineNumber}, {frame}"
        return FormatError(self.name, problem, place=place, expected=expected)

    def _frame_name(self, kind: str, frame: int) -> str:
        return f"frame {self.index[frame]}" if kind == "normal" else f"{kind} frame"

    def _refuse_entity(self, entity: str, *_: object) -> None:
        raise self._error(f"entity '{entity[:40]}'", "no entities: they are neither expanded nor fetched")

    # Outside <frames>.

    def _start_in_header(self, qualified: str, attributes: dict[str, str]) -> None:
        if self.head.start(qualified, attributes):
            self._start_frames(self.head.header)
            self.expat.StartElementHandler = self._start_in_frames
            self.expat.EndElementHandler = self._end_in_frames

    def _end_in_header(self, _: str) -> None:
        self.head.end()

    def _start_frames(self, header: MvnxHeader) -> None:
        def segment_values(field: str, width: int) -> Column:
            count = len(header.labels)
            return Column(field, width * count, f"{width * count} values, {width} for each of {count} segments")

        normal = [segment_values("orientation", 4), segment_values("position", 3), segment_values("angularVelocity", 3)]
        if contacts := len(header.contacts):
            normal.append(Column("footContacts", contacts, f"{contacts} values, one a contactDefinition"))
        self.wanted = {kind: {"orientation": segment_values("orientation", 4)} for kind in REFERENCE_FRAMES}
        self.wanted["normal"] = {column.field: column for column in normal}
        self.met = {kind: {} for kind in self.wanted}

    # Inside <frames>. The first two run for every tag of the file, a hundred thousand times a minute of recording: most tags
    # must leave them after two comparisons.

    def _start_in_frames(self, qualified: str, attributes: dict[str, str]) -> None:
        level = self.level = self.level + 1
        if level == 2:
            if self.columns is not None:
                try:
                    column = self.columns[qualified]
                except KeyError:
                    column = self.columns[qualified] = self.wanted[self.frame_type].get(local_name(qualified))
                if column is not None:
                    self._start_field(column)
        elif level == 1:
            self._start_frame(qualified, attributes)
        elif self.column is not None:
            raise self._frame_error(f"element <{qualified[:40]}> inside <{self.column.field}>", "numbers only")
        elif level > MAX_DEPTH:
            raise self._error(f"elements nested more than {MAX_DEPTH} deep", "an MVNX document")

    def _end_in_frames(self, _: str) -> None:
        level = self.level
        self.level = level - 1
        if level == 2:
            if self.column is not None:
                self.expat.CharacterDataHandler = None
                self.column.end()
                self.column = None
        elif level == 1:
            if self.columns is not None:
                self._end_frame(self.wanted[self.frame_type]["orientation"])
        elif level == 0:
            self.level = 0
            self.expat.StartElementHandler = self._start_in_header
            self.expat.EndElementHandler = self._end_in_header
            self.head.end()

    def _start_frame(self, qualified: str, attributes: Mapping[str, str]) -> None:
        self.columns = None
        if local_name(qualified) != "frame":
            return
        self.frame_type = kind = one_line(attributes.get("type", ""))
        self.frame_count[kind] = self.frame_count.get(kind, 0) + 1
        self.columns = self.met.get(kind)
        if kind == "normal":
            self.index.append(self._frame_index(attributes.get("index")))
        elif self.columns is not None and self.frame_count[kind] > 1:
            raise self._error(f"a second frame of type '{kind}'", "one")

    def _frame_index(self, text: str | None) -> int:
        if not self.index:
            self.indexed = text is not None
        if (text is not None) != self.indexed:
            raise self._error(
                f"a frame {'without' if text is None else 'with'} index", "all frames with index, or none"
            )
        if text is None:
            return len(self.index)
        try:
            index = int(text)
        except ValueError:
            raise self._error(f"frame index {text[:40]!r}", "a whole number") from None
        if abs(index) > _MAX_INDEX:
            raise self._error(f"frame index {text[:40]!r}", f"at most {_MAX_INDEX:g}")
        if self.index and index <= self.index[-1]:
            raise self._error(f"frame index {index} after {self.index[-1]}", "increasing numbers")
        return index

    def _start_field(self, column: Column) -> None:
        frame = self.frame_count[self.frame_type] - 1
        if column.last == frame:
            raise self._frame_error(f"a second <{column.field}>", "one")
        column.last = frame
        column.frames.append(frame)
        column.lines.append(self.expat.CurrentLineNumber)
        self.column = column
        self.expat.CharacterDataHandler = column.add_text

    def _end_frame(self, orientation: Column) -> None:
        if orientation.last != self.frame_count[self.frame_type] - 1:
            raise self._frame_error("no <orientation>", orientation.expected)
        self.whole_frames += self.frame_type == "normal"
