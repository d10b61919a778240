"""What stands in an MVNX document outside its frames: versions, rate, suit configuration, segments and their points.

Read by path, because newer files repeat `<segment>` and `<joint>` for fingers elsewhere. Headers also hold people's names
(`label`, `originalFilename`, `comment`): none of them is read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from xml.parsers.expat import XMLParserType

import numpy as np
from retarget.core.errors import FormatError, nearest
from retarget.core.segments import SEGMENTS
from retarget.core.types import Array
from retarget.formats._number_text import RowError, parse_rows

MIN_RATE_HZ, MAX_RATE_HZ = 0.01, 10_000.0
MAX_DEPTH = 100
_PROP = re.compile(r"Prop ?\d*")

ErrorMaker = Callable[[str, str], FormatError]
"""(what was found, what was expected) → the error to raise, with file and line filled in."""


@dataclass
class MvnxHeader:
    """Facts of a recording that its header states.

    version: the format's own, as written ("3", "4"), "" when missing. mvn_version: that of the software.
    labels: of the segments, in the order in which the frames hold their values.
    points: segment → point label → (3,) m in the segment's T-pose frame; joints only (labels that start with "j").
    sensors: labels of the segments that carry one. contacts: contact label → column of `<footContacts>`.
    """

    version: str = ""
    mvn_version: str = ""
    rate_hz: float = 0.0
    configuration: str = ""
    labels: list[str] = field(default_factory=list)
    points: dict[str, dict[str, Array]] = field(default_factory=dict)
    sensors: list[str] = field(default_factory=list)
    contacts: dict[str, int] = field(default_factory=dict)

    @property
    def major_version(self) -> int | None:
        """3 for "3" and "3.1"; None when missing or no number."""
        match = re.match(r"(\d{1,4})(\.|$)", self.version)
        return int(match[1]) if match else None


def is_prop(label: str) -> bool:
    """Whether a segment is a thing that the person holds; MVN tracks up to four ("Prop1")."""
    return _PROP.fullmatch(label) is not None


def local_name(qualified: str) -> str:
    """An element's name without its prefix."""
    return qualified.rpartition(":")[2]


class HeaderReader:
    """Takes the start and end events of every element outside `<frames>` and fills `header`."""

    def __init__(self, parser: XMLParserType, error: ErrorMaker) -> None:
        self.header = MvnxHeader()
        self.path: list[str] = []
        self.root_seen = False
        self._parser, self._error = parser, error
        self._once: set[str] = set()
        self._point = ""
        self.text: list[str] = []  # of the point that is open

    def start(self, qualified: str, attributes: Mapping[str, str]) -> bool:
        """Take a start tag; True when it is that of `<frames>`, whose content is not for this reader."""
        self.path.append(local_name(qualified))
        self.root_seen = True
        if len(self.path) > MAX_DEPTH:
            raise self._error(f"elements nested more than {MAX_DEPTH} deep", "an MVNX document")
        match self.path:
            case ["mvnx"]:
                self._start_root(attributes)
            case [other]:
                raise self._error(f"root element <{one_line(other)}>", "<mvnx>")
            case ["mvnx", "mvnxInfo"]:
                raise self._error(
                    "MVNX of version 2 (Moven)", "version 3 or 4; export again from MVN Studio 3 or later"
                )
            case ["mvnx", "mvn"]:
                self.header.mvn_version = one_line(attributes.get("version", ""))
            case ["mvnx", "subject"]:
                self._start_subject(attributes)
            case ["mvnx", "subject", "segments"]:
                self._only_once("segments")
            case ["mvnx", "subject", "segments", "segment"]:
                self._start_segment(attributes)
            case ["mvnx", "subject", "segments", "segment", "points", "point"]:
                self._point = attributes.get("label", "")
            case ["mvnx", "subject", "segments", "segment", "points", "point", "pos_b" | "pos_s"]:
                if self._point.startswith("j"):
                    self._parser.CharacterDataHandler = self.text.append
            case ["mvnx", "subject", "sensors", "sensor"]:
                self.header.sensors.append(attributes.get("label", ""))
            case ["mvnx", "subject", "footContactDefinition", "contactDefinition"]:
                self._start_contact(attributes)
            case ["mvnx", "subject", "frames"]:
                self._only_once("frames")
                if not self.header.labels:
                    raise self._error("no <segment> before <frames>", "the segments whose values the frames hold")
                return True
        return False

    def end(self) -> None:
        """Take an end tag."""
        self.path.pop()
        if self._parser.CharacterDataHandler is not None and self.path[-1] == "point":
            self._parser.CharacterDataHandler = None
            self._end_point()

    def _start_root(self, attributes: Mapping[str, str]) -> None:
        self.header.version = one_line(attributes.get("version", ""))
        major = self.header.major_version
        if major is not None and major < 3:
            raise self._error(
                f"MVNX of version {major} (Moven)", "version 3 or 4; export again from MVN Studio 3 or later"
            )

    def _start_subject(self, attributes: Mapping[str, str]) -> None:
        self._only_once("subject")
        self.header.configuration = one_line(attributes.get("configuration", ""))
        text = attributes.get("frameRate")
        expected = f"a number of Hz from {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}"
        if text is None:
            raise self._error("<subject> has no frameRate", expected)
        try:
            rate = float(text)
        except ValueError:
            rate = math.nan
        if not MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
            raise self._error(f"frameRate {one_line(text)!r}", expected)
        self.header.rate_hz = rate

    def _start_segment(self, attributes: Mapping[str, str]) -> None:
        label = attributes.get("label", "")
        if label in self.header.labels:
            raise self._error(f"segment '{one_line(label)}' stands twice", "each label once")
        if label not in SEGMENTS and not is_prop(label):
            near = nearest(label, SEGMENTS)
            raise self._error(
                f"unknown segment '{one_line(label)}'", " or ".join(near) or f"one of {', '.join(SEGMENTS)}"
            )
        self.header.labels.append(label)
        self.header.points[label] = {}

    def _end_point(self) -> None:
        text = "".join(self.text)
        self.text.clear()
        try:
            point = parse_rows([text], 3)[0]
        except RowError as error:
            raise self._error(f"point '{one_line(self._point)}': {error.problem}", "3 coordinates in m") from None
        if not np.isfinite(point).all():
            raise self._error(f"point '{one_line(self._point)}': {point} m", "finite coordinates")
        self.header.points[self.header.labels[-1]][self._point] = point

    def _start_contact(self, attributes: Mapping[str, str]) -> None:
        contacts = self.header.contacts
        label, text = attributes.get("label", ""), attributes.get("index", str(len(contacts)))
        if (
            not (text.isascii() and text.isdigit() and len(text) < 4)
            or int(text) in contacts.values()
            or label in contacts
        ):
            raise self._error(
                f"contactDefinition '{one_line(label)}' with index '{one_line(text)}'", "each label and index once"
            )
        contacts[label] = int(text)

    def _only_once(self, element: str) -> None:
        if element in self._once:
            raise self._error(f"a second <{element}>", "one person, one recording")
        self._once.add(element)


def one_line(text: str) -> str:
    """Text of the file as it may stand in a message: without line breaks, not too long."""
    text = " ".join(text.split())
    return text if len(text) <= 40 else text[:40] + "…"
