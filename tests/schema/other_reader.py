"""Reads a log without the programs of this repository: written from schema/store/block/FORMAT.md alone, and from its
tables while it runs (format_page.py).

    python3 other_reader.py LOG ROBOT SOURCE

prints each answer of that robot (its number) and source (its name) as one JSON line, bodies and headers in
hexadecimal. Every sum that FORMAT.md describes is made again; one that does not fit ends the program with exit code 1.
Exit code 77: SQLite or libzstd is not here. What ways of storing were met goes to standard error.
"""

import json
import os
import re
import struct
import sys

try:
    import sqlite3
except ImportError:
    print("no SQLite", file=sys.stderr)
    sys.exit(77)

sys.dont_write_bytecode = True  # of the modules beside it

import format_page as page
from other_block import block_answers, hot_answers
from other_numbers import MASK, USED, Damage, crc, need, signed


# Sums


def i64(value):
    return struct.pack("<q", signed(value))


def of(value):
    if isinstance(value, int):
        return i64(value)
    if isinstance(value, float):
        return struct.pack("<d", value + 0.0)
    value = value.encode() if isinstance(value, str) else value
    return i64(len(value)) + value


def row_crc(values):
    return signed(crc(b"".join(of(value) for value in values)), 32)


def sealed(value):
    if value is None:
        return i64(0) + i64(0)
    if isinstance(value, int):
        return i64(value)
    if isinstance(value, float):
        return struct.pack("<d", value)
    value = value.encode() if isinstance(value, str) else value
    return i64(1) + i64(len(value)) + value


TABLES = ("hot", "block", "gap", "event", "clock", "rollup", "manifest")


def check_rows(part):
    for table in TABLES:
        for row in part.execute(f"SELECT * FROM {table}"):
            USED.add(f"row of {table}")
            between = [name for name in row.keys() if name not in ("id", "crc")]
            names = page.COVERED.get(table, between)
            values = [row[name] for name in names]
            if table == "hot" and row["base"] is None:
                values[names.index("base")] = 0
            if table == "clock":
                values[-1:] = [0, 0] if row["robot_us"] is None else [1, row["robot_us"]]
            need(row_crc(values) == row["crc"], f"crc of a row of {table}")


def check_seals(part, closed):
    columns = {"field names": ("field", "id, name"), "code names": ("code", "list, value, name")}
    names = set()
    for seal in part.execute("SELECT * FROM seal").fetchall():
        names.add(seal["name"])
        table, what = columns.get(seal["name"], (seal["name"], "*"))
        rows = part.execute(f"SELECT {what} FROM {table}").fetchall()
        need(len(rows) == seal["rows"], f"rows of {table}")
        if seal["crc"] is not None:
            data = b"".join(sealed(value) for row in rows for value in row)
            need(signed(crc(data), 32) == seal["crc"], f"seal of {table}")
    small = {"part", "robot", "session", "stream", "field", "code", "coverage", "unknown_key"} | set(columns)
    counted = {"gap", "event", "clock", "rollup", "manifest"}
    need(names == small | (counted if closed else set()), "seals")


def row_hash(source, session, answer):
    _, seq, send, recv, header, body = answer
    numbers = dict(source=page.SOURCES[source], session=session, seq=seq, t_send_us=send, t_recv_us=recv)
    numbers["length"] = len(header)
    data = b"".join((numbers[name] & MASK).to_bytes(16, "little")[:size] for name, size in page.HASHED) + header + body
    value = page.FNV_START
    for byte in data:
        value = ((value ^ byte) * page.FNV_FACTOR) & MASK
    return value


def check_manifest(part, robot, source, moved):
    hours = {}
    for session, answer in moved:
        hour = answer[2] // 3_600_000_000 * 3_600_000_000
        rows, total = hours.get(hour, (0, 0))
        hours[hour] = (rows + 1, (total + row_hash(source, session, answer)) & MASK)
    rows = part.execute("SELECT * FROM manifest WHERE robot = ? AND source = ?", (robot, page.SOURCES[source]))
    need({r["hour_us"]: (r["rows"], r["hash"] & MASK) for r in rows} == hours, "manifest")


# Parts and the folder


def part_answers(path, robot, source):
    """(place, session, answer) of a part, in order."""
    part = sqlite3.connect(f"file:{path}?mode=ro", uri=True, isolation_level=None)
    part.row_factory = sqlite3.Row
    need(part.execute("PRAGMA application_id").fetchone()[0] == page.APPLICATION, "not a part")
    need(part.execute("PRAGMA user_version").fetchone()[0] == page.VERSION, "another version")
    part.execute("BEGIN")
    check_rows(part)
    check_seals(part, part.execute("SELECT closed FROM part").fetchone()[0])
    codes = dict(part.execute("SELECT name, value FROM code WHERE list = 'source'").fetchall())
    need(codes == page.SOURCES, "code list source")
    number = codes[source]
    moved = []
    for row in part.execute("SELECT * FROM block WHERE robot = ? AND source = ?", (robot, number)):
        moved += [(row["session"], answer) for answer in block_answers(row, source)]
    check_manifest(part, robot, source, moved)
    hot, last = [], {}
    for row in part.execute("SELECT * FROM hot WHERE robot = ? AND source = ? ORDER BY id", (robot, number)):
        need(row["base"] is None or row["base"] in last, "base")
        answers = hot_answers(row, None if row["base"] is None else last[row["base"]])
        last[row["id"]] = answers[-1][5]
        hot += [(row["session"], answer) for answer in answers]
    part.close()
    return sorted(hot + moved, key=lambda item: item[1][0])


def main(folder, robot, source):
    names = [n for n in os.listdir(folder) if re.fullmatch(r"part-\d+\.db", n)]
    before = (0, -1)
    for name in sorted(names, key=lambda n: int(n[5:-3])):
        for session, (_, seq, send, recv, header, body) in part_answers(os.path.join(folder, name), robot, source):
            if (session, seq) <= before:
                continue
            before = (session, seq)
            line = dict(session=session, seq=seq, t_send_us=send, t_recv_us=recv, header=header.hex(), body=body.hex())
            print(json.dumps(line, separators=(",", ":")))


if __name__ == "__main__":
    try:
        main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
        print("\n".join(sorted(USED)), file=sys.stderr)
    except Damage as damage:
        print("damaged:", damage, file=sys.stderr)
        sys.exit(1)
