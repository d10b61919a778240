"""Mutations of a file: of its bytes, of the numbers and words in its text, and of what a container holds, behind valid checksums."""

from __future__ import annotations

import gzip
import io
import random
import re
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence

Mutation = Callable[[random.Random, bytes], bytes]

MAX_BYTES = 1 << 20
"""No mutated file is longer: what is looked for is how a reader takes an input, not how long it takes one that is long."""

NUMBERS = (
    *(b"0", b"-0", b"1", b"-1", b"0.5", b"255", b"65535", b"4294967295", b"9223372036854775807", b"1e308", b"-1e308"),
    *(b"1e309", b"1e-320", b"nan", b"-inf", b"0x10", b"1_0", b"1.", b".", b"-", b"1e", b"1e9", b"1e99", b"1#IND"),
    *(b"9" * 20, b"9" * 400, b"9" * 5000, b"0." + b"1" * 400, "٣".encode(), "½".encode(), b"true", b"null"),
)
WORDS = (
    *(b"", b" ", b"\0", b"\n", b"\r", b"\t", b'"', b"'", b",", b";", b"#", b"=", b"\\", b"\xff\xfe", b"\xef\xbb\xbf"),
    *(b"[" * 3000, b"{" * 300, b"(" * 50, b"a." * 300, b'{"a":' * 2000, b"<a>" * 300, b"]", b"}", b"<", b">", b"&amp;"),
    *(b"&#0;", b"&#x110000;", b"<!--", b"<![CDATA[", b"]]>", b"<?xml version='1.0' encoding='utf-16'?>", b"</frames>"),
    b'<!DOCTYPE a [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;">]>',
    b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
    *("é".encode(), "\u202e".encode(), "\U0001f600".encode(), b"\xed\xa0\x80", b"../../x", b"/", b"x" * 300, b"%s{0}"),
)
_WHOLE = (
    0,
    1,
    -1,
    2,
    127,
    128,
    255,
    256,
    1 << 15,
    1 << 16,
    (1 << 31) - 1,
    1 << 31,
    (1 << 32) - 1,
    1 << 40,
    (1 << 63) - 1,
)
_NUMBER = re.compile(rb"[-+]?[0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]+)?")
_WORD = re.compile(rb"[A-Za-z_]+")


def of_bytes(rng: random.Random, data: bytes) -> bytes:
    """Bytes replaced, cut, doubled, moved, or overwritten by whole numbers of 2, 4 or 8 bytes that are extremes."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        if not out:
            break
        at, kind = rng.randrange(len(out)), rng.randrange(9)
        end = min(len(out), at + rng.choice((1, 2, 4, 8, 16, 64, 400)))
        if kind == 0:
            out[at] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        elif kind == 1:
            out[at] ^= 1 << rng.randrange(8)
        elif kind == 2:
            del out[at:end]
        elif kind == 3:
            out[at:at] = out[at:end] * rng.choice((1, 1, 2, 20))
        elif kind == 4:
            size = rng.choice((2, 4, 8))
            value = rng.choice(_WHOLE) & ((1 << 8 * size) - 1)
            out[at : at + size] = value.to_bytes(size, rng.choice(("little", "little", "big")))
        elif kind == 5:
            out[at : at + 8] = struct.pack("<d", rng.choice((float("nan"), float("inf"), -1e308, 1e-320, 1e18, 0.0)))
        elif kind == 6:
            to = rng.randrange(len(out))
            out[to:to] = out[at:end]
        elif kind == 7:
            out[at:end] = rng.randbytes(rng.randrange(40))
        elif rng.random() < 0.3:
            del out[at:]
    return bytes(out[:MAX_BYTES])


def of_text(rng: random.Random, data: bytes) -> bytes:
    """Numbers, words and lines of a text replaced, dropped, doubled or exchanged."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        kind = rng.randrange(6)
        if kind <= 1:
            data = _replaced(rng, data, _NUMBER, NUMBERS)
        elif kind == 2:
            data = _replaced(rng, data, _WORD, WORDS)
        elif kind == 3:
            at = rng.randrange(len(data) + 1)
            data = data[:at] + rng.choice(rng.choice((NUMBERS, WORDS))) + data[at:]
        elif kind == 4:
            lines = data.split(b"\n")
            one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
            act = rng.randrange(3)
            if act == 0:
                del lines[one]
            elif act == 1:
                lines.insert(other, lines[one])
            else:
                lines[one], lines[other] = lines[other], lines[one]
            data = b"\n".join(lines)
        else:
            data = of_bytes(rng, data)
    return data[:MAX_BYTES]


def over_bytes(rng: random.Random, data: bytes) -> bytes:
    """Bytes overwritten in place, so that everything else stays where offsets, lengths and pages say."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        at, size = rng.randrange(len(out)), rng.choice((1, 2, 4, 8))
        value = rng.choice((*_WHOLE, *_WHOLE, rng.getrandbits(64), out[at] ^ 1 << rng.randrange(8)))
        part = (value & ((1 << 8 * size) - 1)).to_bytes(size, rng.choice(("little", "big")))
        out[at : at + size] = part[: len(out) - at]
    return bytes(out)


def in_sqlite(rng: random.Random, data: bytes) -> bytes:
    """A database with a value, a column or a table changed, by SQLite itself; sometimes the file's own bytes."""
    if rng.random() < 0.4:
        return rng.choice((of_bytes, over_bytes))(rng, data)
    connection = sqlite3.connect(":memory:", isolation_level=None)
    try:
        connection.deserialize(data)
        tables = [name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        table = rng.choice(tables)
        columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
        column, rows = rng.choice(columns), connection.execute(f"SELECT rowid, * FROM {table}").fetchall()
        act = rng.randrange(12)
        if act == 0:
            connection.execute(f"DROP TABLE {table}")
        elif act == 1:
            connection.execute(f"ALTER TABLE {table} RENAME COLUMN {column} TO other")
        elif act == 2:
            connection.execute(f"DELETE FROM {table} WHERE rowid % {rng.randrange(1, 5)} = 0")
        elif act == 3:
            connection.execute(f"ALTER TABLE {table} RENAME TO real_{table}")
            connection.execute(rng.choice(_VIEWS).format(table=table, columns=", ".join(columns), column=column))
        elif rows:
            row = rng.choice(rows)
            old = row[1 + columns.index(column)]
            connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (_other_value(rng, old), row[0]))
        return connection.serialize()[:MAX_BYTES]
    except (sqlite3.Error, OverflowError):  # a change that a constraint refuses
        return over_bytes(rng, data)
    finally:
        connection.close()


_VIEWS = (
    "CREATE VIEW {table} AS SELECT {columns} FROM real_{table}",
    "CREATE VIEW {table} AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT {columns} FROM n, real_{table}",
    "CREATE TABLE {table} ({columns}, big AS (randomblob(1000000000)))",
    "CREATE TABLE {table} ({columns})",
)


def _other_value(rng: random.Random, old: object) -> object:
    """A value in place of `old`: one of its kind mutated, or of another kind."""
    if isinstance(old, bytes) and rng.random() < 0.8:
        return rng.choice((of_bytes, over_bytes))(rng, old or b"\0")
    if isinstance(old, str) and rng.random() < 0.8:
        return of_text(rng, old.encode()).decode("utf-8", "replace")
    return rng.choice((None, 1.5, "text", b"\0\1\0\0", 0, -1, (1 << 63) - 1, -(1 << 63), rng.randrange(1000)))


def in_gzip(rng: random.Random, data: bytes) -> bytes:
    """The text in a gzip file mutated and packed again; sometimes the file's own bytes."""
    if rng.random() < 0.3:
        return of_bytes(rng, data)
    return gzip.compress(of_text(rng, gzip.decompress(data)), 1, mtime=0)


def in_zip(rng: random.Random, data: bytes) -> bytes:
    """One member of an archive mutated (array headers as text), left out or doubled, and packed again; sometimes the file's own bytes."""
    if rng.random() < 0.3:
        return of_bytes(rng, data)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    names = list(members)
    chosen = rng.choice(names)
    act = rng.randrange(8)
    if act == 0:
        del members[chosen]
    elif act == 1:
        members[chosen] = members[rng.choice(names)]
    elif act <= 4:
        head, tail = members[chosen][:128], members[chosen][128:]
        members[chosen] = of_text(rng, head) + tail
    else:
        members[chosen] = of_bytes(rng, members[chosen])
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content)
    return out.getvalue()


def in_records(rng: random.Random, data: bytes) -> bytes:
    """An MCAP file: bytes mutated as they are or, where checksums would catch that, inside a record whose length is kept true."""
    if rng.random() < 0.3:
        return of_bytes(rng, data)
    records, at = [], 8
    while at + 9 <= len(data) - 8:
        opcode, size = struct.unpack_from("<BQ", data, at)
        records.append((opcode, data[at + 9 : at + 9 + size]))
        at += 9 + size
    act = rng.randrange(10)
    one = rng.randrange(len(records))
    if act == 0:
        del records[one]
    elif act == 1:
        records.insert(rng.randrange(len(records)), records[one])
    else:
        opcode, content = records[one]
        records[one] = (
            rng.choice((opcode, opcode, opcode, rng.randrange(16))),
            rng.choice((of_bytes, of_text))(rng, content),
        )
    body = b"".join(struct.pack("<BQ", opcode, len(content)) + content for opcode, content in records)
    return (data[:8] + body + data[-8:])[:MAX_BYTES]


def bomb(text: bytes, repeat: int) -> bytes:
    """`text` gzipped with its last line repeated so many times."""
    body, last = text.rstrip(b"\n").rsplit(b"\n", 1)
    pack = zlib.compressobj(9, wbits=31)
    parts = [pack.compress(body + b"\n")]
    block = (last + b"\n") * 1000
    parts += [pack.compress(block) for _ in range(repeat // 1000)]
    return b"".join([*parts, pack.flush()])


def _replaced(rng: random.Random, data: bytes, pattern: re.Pattern[bytes], choices: Sequence[bytes]) -> bytes:
    start = rng.randrange(len(data) + 1)
    found = pattern.search(data, start) or pattern.search(data)
    return data if found is None else data[: found.start()] + rng.choice(choices) + data[found.end() :]
