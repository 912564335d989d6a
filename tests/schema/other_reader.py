"""Reads a log without the programs of this repository: written from schema/store/block/FORMAT.md alone.

    python3 other_reader.py LOG ROBOT SOURCE

prints each answer of that robot (its number) and source (its name) as one JSON line, bodies and headers in
hexadecimal. Every sum that FORMAT.md describes is made again; one that does not fit ends the program with exit code 1.
Exit code 77: libzstd is not here. What ways of storing were met goes to standard error.
"""

import ctypes
import ctypes.util
import fractions
import json
import os
import re
import sqlite3
import struct
import sys

MASK = (1 << 64) - 1
MAGIC = b"\x28\xb5\x2f\xfd"
IMAGES = ("registers", "inputs")
USED = set()  # ways of storing that were met


class Damage(Exception):
    pass


def need(condition, what):
    if not condition:
        raise Damage(what)


# Words used here


def signed(value, bits=64):
    value &= (1 << bits) - 1
    return value - (1 << bits) if value >> (bits - 1) else value


def unzigzag(value):
    return (value >> 1) ^ -(value & 1)


class Bytes:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, count):
        need(self.at + count <= len(self.data), "bytes end early")
        self.at += count
        return self.data[self.at - count : self.at]

    def rest(self):
        return self.take(len(self.data) - self.at)

    def done(self):
        return self.at == len(self.data)

    def number(self, form):
        return struct.unpack("<" + form, self.take(struct.calcsize("<" + form)))[0]

    def varint(self):
        value = 0
        for shift in range(0, 70, 7):
            byte = self.number("B")
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise Damage("varint")

    def svarint(self):
        return unzigzag(self.varint())


def crc_table():
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = (byte >> 1) ^ (0x82F63B78 if byte & 1 else 0)
        table.append(byte)
    return table


TABLE = crc_table()


def crc(data):
    state = 0xFFFFFFFF
    for byte in data:
        state = (state >> 8) ^ TABLE[(state ^ byte) & 0xFF]
    return state ^ 0xFFFFFFFF


need(crc(b"123456789") == 0xE3069283, "crc")


# zstd


def load_zstd():
    name = ctypes.util.find_library("zstd") or "libzstd.so.1"
    try:
        library = ctypes.CDLL(name)
    except OSError:
        print("no libzstd", file=sys.stderr)
        sys.exit(77)
    library.ZSTD_createDCtx.restype = ctypes.c_void_p
    library.ZSTD_DCtx_refPrefix.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t]
    library.ZSTD_DCtx_refPrefix.restype = ctypes.c_size_t
    library.ZSTD_decompressDCtx.argtypes = [
        ctypes.c_void_p,
        ctypes.c_char_p,
        ctypes.c_size_t,
        ctypes.c_char_p,
        ctypes.c_size_t,
    ]
    library.ZSTD_decompressDCtx.restype = ctypes.c_size_t
    return library


ZSTD = load_zstd()
CONTEXT = ZSTD.ZSTD_createDCtx()


def unzstd(stored, length, prefix=b""):
    frame = MAGIC + stored
    out = ctypes.create_string_buffer(max(length, 1))
    if prefix:
        ZSTD.ZSTD_DCtx_refPrefix(CONTEXT, prefix, len(prefix))
    got = ZSTD.ZSTD_decompressDCtx(CONTEXT, out, length, frame, len(frame))
    need(got == length, "zstd frame")
    return out.raw[:length]


# Data of a hot row


def hot_answers(row, base):
    """Answers of a row: (place, seq, t_send_us, t_recv_us, header, body)."""
    data = Bytes(row["data"])
    numbers = []
    place, seq, send = row["id"], row["seq"] & MASK, row["t_send_us"]
    distance = trip = length = 0
    for i in range(row["rows"]):
        flags = data.number("B")
        if i > 0:
            place += 1 + data.varint()
            seq = (seq + 1 + (data.varint() if flags & 8 else 0)) & MASK
        distance = signed(distance + (data.svarint() if flags & 16 else 0))
        send = signed(send + distance) if i > 0 else send
        trip = signed(trip + data.svarint())
        length += data.svarint() if flags & 2 else 0
        header = data.take(data.varint()) if flags & 4 else b""
        numbers.append((flags & 1, length, place, seq, send, signed(send + trip), header))
    lengths = [n[1] for n in numbers if not n[0]]
    bodies = Bytes(hot_bodies(data, lengths, len({n[1] for n in numbers}) == 1, base))
    answers, body = [], base
    for repeats, length, place, seq, send, recv, header in numbers:
        body = body if repeats else bodies.take(length)
        need(body is not None and len(body) == length, "body that repeats")
        answers.append((place, seq, send, recv, header, body))
    return answers


def hot_bodies(data, lengths, alike, base):
    total = sum(lengths)
    if data.done():
        need(not lengths, "no bodies")
        return b""
    method, content = data.number("B"), data.rest()
    USED.add(f"method {method}" + (" with base" if method and base is not None else ""))
    if method == 0:
        need(len(content) == total, "plain bodies")
        return content
    if method == 1:
        return unzstd(content, total, base or b"")
    need(method == 2 and alike and lengths, "method")
    turned, rows, length = unzstd(content, total), len(lengths), lengths[0]
    out = bytearray(total)
    for at in range(length):
        byte = base[at] if base is not None else 0
        for row in range(rows):
            byte = (byte + turned[at * rows + row]) & 0xFF
            out[row * length + at] = byte
    return bytes(out)


# Data of a block: pieces, texts, integers


def piece(data, length):
    header = data.varint()
    stored = data.take(header >> 1)
    stored = unzstd(stored, length) if header & 1 else stored
    need(len(stored) == length, "piece")
    return stored


def texts(data, count):
    inner = Bytes(piece(data, data.varint()))
    lengths = [inner.varint() for _ in range(count)]
    out = [inner.take(length) for length in lengths]
    need(inner.done(), "texts")
    return out


def distinct(data, count):
    known = texts(data, data.varint())
    index = integers(data, count) if len(known) > 1 else [0] * count
    return [known[i] for i in index]


def integers(data, n):
    if n == 0:
        return []
    flags, low = data.number("B"), data.number("B")
    prediction, planes = flags & 3, flags >> 4
    USED.update([f"prediction {prediction}"] + ["sparse"] * bool(flags & 4) + ["one by one"] * bool(flags & 8))
    USED.update(["low bits"] * bool(low) + ["together"] * (planes > 1 and not flags & 8))
    seed = data.svarint()
    slope = data.svarint() if prediction >= 2 else 0
    stored = range(n)
    if flags & 4:
        bitmap = piece(data, (n + 7) // 8)
        stored = [i for i in range(n) if bitmap[i // 8] >> (i % 8) & 1]
    m = len(stored)
    low_bits = int.from_bytes(data.take((m * low + 7) // 8), "little")
    if flags & 8:
        planes = [piece(data, m) for _ in range(planes)]
    elif planes:
        together = piece(data, planes * m)
        planes = [together[p * m : (p + 1) * m] for p in range(planes)]
    else:
        planes = []
    residuals = [0] * n
    for k, i in enumerate(stored):
        high = sum(plane[k] << (8 * p) for p, plane in enumerate(planes))
        residuals[i] = high << low | (low_bits >> (k * low) & ((1 << low) - 1))
    return predicted(prediction, seed, slope, residuals)


def predicted(prediction, seed, slope, residuals):
    if prediction == 0:
        return [signed(seed + r) for r in residuals]
    if prediction == 3:
        return [signed(seed + r + (signed(i * slope) >> 16)) for i, r in enumerate(residuals)]
    values = []
    value, step = (seed - slope, slope) if prediction == 2 else (seed, 0)
    for r in residuals:
        difference = unzigzag(r & MASK)
        step = step + difference if prediction == 2 else difference
        value += step
        values.append(signed(value))
    return values


# Styles


class Style:
    def __init__(self, data):
        self.kind = data.number("B")
        need(self.kind <= 7, "kind of number")
        USED.add(f"kind {self.kind}")
        if self.kind == 0:
            first = data.number("B")
            self.decimals, self.pointed = first & 0x7F, bool(first & 0x80)
            self.least, self.width = data.number("B"), data.number("B")
        elif self.kind in (1, 2):
            self.flags, self.digits = data.number("B"), data.number("B")
            USED.update([f"digits {min(self.digits, 5)}"] + ["shorter"] * bool(self.flags & 2))
            self.begin, self.end = data.number("b"), data.number("b")
        elif self.kind in (4, 5, 6):
            self.order, self.decimals = data.number("B"), data.number("B")
            USED.add(f"order {self.order}")

    def text(self, value):
        if self.kind == 0:
            return self.decimal(value)
        if self.kind in (1, 2):
            return self.real(value)
        if self.kind == 3:
            return struct.pack(">H", value & 0xFFFF)
        if self.kind == 7:
            return bytes([value & 0xFF])
        bits = value & 0xFFFFFFFF
        if self.kind == 6:
            size = float(-value - 1 if value < 0 else value) / 10.0**self.decimals
            bits = struct.unpack("<I", struct.pack("<f", -size if value < 0 else size))[0]
        a, b, c, d = struct.pack(">I", bits)
        return bytes(((c, d, a, b), (a, b, c, d), (b, a, d, c), (d, c, b, a))[self.order])

    def decimal(self, value):
        if value == -1 and self.pointed:
            return b"-0.0"
        size = str(-value - 1 if value < 0 else value).rjust(self.width + self.decimals, "0")
        whole, fraction = size[: len(size) - self.decimals], size[len(size) - self.decimals :]
        while len(fraction) > self.least and fraction.endswith("0"):
            fraction = fraction[:-1]
        return (("-" if value < 0 else "") + whole + ("." + fraction if fraction else "")).encode()

    def real(self, value):
        bits = value & (MASK if self.kind == 1 else 0xFFFFFFFF)
        form, whole = ("<d", "<Q") if self.kind == 1 else ("<f", "<I")
        number = struct.unpack(form, struct.pack(whole, bits))[0]
        minus = "-" if bits >> (63 if self.kind == 1 else 31) else ""
        if number == 0 and minus and self.flags & 1:
            return b"-0.0"
        digits, p = self.digits_of(abs(number))
        if self.flags & 2:
            text = shorter(abs(number), digits, p)
        elif self.begin <= p <= self.end:
            text = fixed(digits, p, ".0" if self.flags & 16 else "")
        else:
            text = scientific(digits, p, bool(self.flags & 8), 2 if self.flags & 4 else 1)
        return (minus + text).encode()

    def digits_of(self, number):
        """d1d2... and p of 0.d1d2... x 10^p."""
        if number == 0:
            return "0", 1
        if self.digits >= 5 and not self.flags & 2:
            return digits_in("%.*e" % (self.digits - 1, number))
        if self.digits == 1 and self.kind == 2:
            return fewest_of_float(number)
        return fewest_of_double(number)


def fewest_of_double(number):
    """repr() has these digits."""
    mantissa, _, exponent = repr(number).partition("e")
    whole, _, fraction = mantissa.partition(".")
    digits = (whole + fraction).lstrip("0")
    leading = len(whole + fraction) - len(digits)
    return digits.rstrip("0"), int(exponent or 0) + len(whole) - leading


def digits_in(text):
    mantissa, exponent = text.split("e")
    digits = mantissa.replace(".", "").rstrip("0")
    return digits or "0", int(exponent) + 1


FLOATS = {}


def fewest_of_float(number):
    """Decimals between the middles to the neighbours read back as the same float; the ends too when its bits are even."""
    if number in FLOATS:
        return FLOATS[number]
    bits = struct.unpack("<I", struct.pack("<f", number))[0]
    exact = fractions.Fraction(number)
    below = fractions.Fraction(struct.unpack("<f", struct.pack("<I", bits - 1))[0])
    # Above the largest float the steps go on.
    step = struct.unpack("<f", struct.pack("<I", bits + 1))[0] if bits < 0x7F7FFFFF else 2.0**128
    low, high = (below + exact) / 2, (exact + fractions.Fraction(step)) / 2
    for count in range(1, 10):
        digits, p = digits_in("%.*e" % (count - 1, number))
        whole, unit = int(digits.ljust(count, "0")), fractions.Fraction(10) ** (p - count)
        found = [
            candidate
            for candidate in (whole - 1, whole, whole + 1)
            if (low <= candidate * unit <= high if bits % 2 == 0 else low < candidate * unit < high)
        ]
        if found:
            best = min(found, key=lambda candidate: abs(candidate * unit - exact))
            text = str(best)
            FLOATS[number] = (text.rstrip("0"), p - count + len(text))
            return FLOATS[number]
    raise Damage("float")


def fixed(digits, p, behind_whole):
    if p <= 0:
        return "0." + "0" * -p + digits
    if p >= len(digits):
        return digits + "0" * (p - len(digits)) + behind_whole
    return digits[:p] + "." + digits[p:]


def scientific(digits, p, plus, least):
    exponent = p - 1
    sign = "-" if exponent < 0 else "+" if plus else ""
    return digits[0] + ("." + digits[1:] if len(digits) > 1 else "") + "e" + sign + str(abs(exponent)).rjust(least, "0")


def shorter(number, digits, p):
    without, with_exponent = fixed(digits, p, ""), scientific(digits, p, True, 2)
    if len(without) > len(with_exponent):
        return with_exponent
    return str(int(number)) if p >= len(digits) else without


# Data of a block: directory, columns, shapes


class Entry:
    def __init__(self, data, constants, position=None):
        self.position = position
        self.form = data.number("B")
        self.parts = []
        USED.add(f"form {self.form}")
        if self.form == 0:
            self.constant = next(constants)
            self.length = 0
            return
        self.count, self.length, self.crc = data.varint(), data.varint(), data.number("I")
        if self.form == 1:
            self.exceptions = data.varint()
            self.style = Style(data)
            if self.style.kind == 1:
                self.statistics = [data.number("q") for _ in range(4)]
            else:
                least = data.svarint()
                self.statistics = [least] + [signed(least + data.varint()) for _ in range(3)]
        elif self.form == 3:
            self.parts = [Entry(data, constants) for _ in range(data.varint())]
        else:
            need(self.form == 2, "form")

    def bytes(self):
        return self.length + sum(part.bytes() for part in self.parts)

    def take_frame(self, data):
        if self.form != 0:
            self.frame = data.take(self.length)
            need(crc(self.frame) == self.crc, "crc of a frame")
        for part in self.parts:
            part.take_frame(data)

    def numbers(self):
        """The integers of a column of the rows."""
        data = Bytes(self.frame)
        values = integers(data, self.count)
        need(self.form == 1 and data.done(), "numbers")
        self.check_statistics(values)
        return values

    def check_statistics(self, values):
        need(not values or self.statistics[2:] == [values[0], values[-1]], "first and last of a column")
        if self.style.kind not in (1, 2, 5) and values:
            need(self.statistics[:2] == [min(values), max(values)], "min and max of a column")

    def texts(self, constants, count):
        if self.form == 0:
            return [constants[self.constant]] * count
        need(self.count == count, "count of a column")
        data = Bytes(self.frame)
        if self.form == 2:
            out = distinct(data, count)
        elif self.form == 1:
            exceptions = {}
            if self.exceptions:
                USED.add("exceptions")
                at = integers(data, self.exceptions)
                exceptions = dict(zip(at, distinct(data, self.exceptions)))
            values = integers(data, count)
            self.check_statistics([v for i, v in enumerate(values) if i not in exceptions])
            out = [exceptions[i] if i in exceptions else self.style.text(v) for i, v in enumerate(values)]
        else:
            pieces = texts(data, 1)[0].split(b"\0")
            need(len(pieces) == len(self.parts) + 1, "parts")
            parts = [part.texts(constants, count) for part in self.parts]
            out = [pieces[0] + b"".join(p[i] + end for p, end in zip(parts, pieces[1:])) for i in range(count)]
        need(data.done(), "end of a frame")
        return out


def json_holes(shape):
    """Pieces of a shape, and the name of each hole."""
    tree = json.loads(shape.replace(b"\0", b"0"), object_pairs_hook=list)
    names = []

    def walk(pairs, path):
        for key, value in pairs:
            if isinstance(value, list):
                walk(value, path + (key,))
            else:
                names.append(path + (key,))

    walk(tree, ())
    return shape.split(b"\0"), names


def image_holes(shape):
    pieces, names, data = [], [], Bytes(shape)
    while not data.done():
        head = data.take(4)
        address, count = struct.unpack(">HH", head)
        end, before = address + count, head
        while address < end:
            letter = data.take(1)
            covered = {b"w": 1, b"f": 2, b"i": 2, b"b": 8}[letter]
            names.append((address, min(address + covered, end) - 1))
            pieces.append(before)
            address, before = address + covered, b""
    return pieces + [b""], names


def columns_of_shapes(shapes, images):
    """Per shape its pieces and the column of each hole; and how many columns there are."""
    numbers, out = {}, []
    for shape in shapes:
        pieces, names = (image_holes if images else json_holes)(shape)
        need(len(pieces) == len(names) + 1, "shape")
        met, columns = {}, []
        for name in names:
            met[name] = met.get(name, -1) + 1
            columns.append(numbers.setdefault((name, met[name]), len(numbers)))
        out.append((pieces, columns))
    return out, len(numbers)


def block_answers(row, source):
    block = row["data"]
    need(block[:8] == b"TACHOBLK" and block[8] == 1 and block[11] == 0, "head of a block")
    head = struct.unpack("<BBBBIQIIIIIQQqq", block[8:76])
    _, number, _, _, sum_, size, directory, robot, session, rows, raw_rows, seq1, seq2, t1, t2 = head
    need(size == len(block) and crc(block[:12] + block[16 : 76 + directory]) == sum_, "crc of a head")
    need((robot, session, rows) == (row["robot"], row["session"], row["rows"]) and number == SOURCES[source], "head")
    data, frames = Bytes(block[76 : 76 + directory]), Bytes(block[76 + directory :])
    columns, entries = data.varint(), data.varint()
    described = [(data.varint(), data.varint(), data.number("I")) for _ in range(2)]
    text_frames = []
    for count, length, frame_crc in described:
        frame = frames.take(length)
        need(crc(frame) == frame_crc, "crc of texts")
        frame = Bytes(frame)
        text_frames.append(texts(frame, count))
        need(frame.done(), "texts")
    shapes, constants = text_frames
    numbers, position, found = iter(range(columns - entries, len(constants))), 0, {}
    for _ in range(entries):
        position += data.varint()
        found[position] = Entry(data, numbers, position)
        position += 1
    need(data.done() and position <= columns, "directory")
    for entry in sorted(found.values(), key=lambda e: (e.bytes(), e.position)):
        entry.take_frame(frames)
    need(frames.done(), "frames")
    plain = iter(range(columns - entries))
    constant_of = {c: next(plain) for c in range(columns) if c not in found}

    def column(c, count):
        return found[c].texts(constants, count) if c in found else [constants[constant_of[c]]] * count

    seq, send, trip, shape, place = (found[c].numbers() for c in (0, 1, 2, 3, 6))
    headers, raw = column(4, rows), iter(column(5, raw_rows))
    recipes, leaves = columns_of_shapes(shapes, source in IMAGES)
    need(leaves == columns - 7 and shape.count(0) == raw_rows, "columns")
    counts = [0] * leaves
    for s in shape:
        for leaf in recipes[s - 1][1] if s else ():
            counts[leaf] += 1
    values = [iter(column(7 + leaf, counts[leaf])) for leaf in range(leaves)]
    out = []
    for i in range(rows):
        if shape[i] == 0:
            body = next(raw)
        else:
            pieces, holes = recipes[shape[i] - 1]
            body = pieces[0] + b"".join(next(values[leaf]) + end for leaf, end in zip(holes, pieces[1:]))
        out.append((place[i], seq[i] & MASK, send[i], signed(send[i] + trip[i]), headers[i], body))
    first, last = out[0], out[-1]
    need((seq1, seq2, t1, t2) == (first[1], last[1], first[2], last[2]), "ends in the head")
    need((row["row_from"], row["row_to"]) == (first[0], last[0]), "places in the row")
    need((row["t_from_us"], row["t_to_us"]) == (min(send), max(send)), "times in the row")
    return out


SOURCES = dict(status=0, io=1, registers=2, inputs=3, pose=4, push=5, ring=6)


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


CRCS = {
    "hot": "id robot source session seq t_send_us base rows data",
    "block": "robot source session seq_from seq_to row_from row_to t_from_us t_to_us rows",
    "gap": "robot source session seq_from seq_count t_from_us t_to_us cause partial detail",
    "event": "robot source session kind seq t_from_us t_us subject old_value new_value detail",
    "clock": "robot session wall_us mono_us robot_us",
    "rollup": "robot source minute field rows min max sum last",
    "manifest": "robot source hour_us rows hash",
}


def check_rows(part):
    for table, columns in CRCS.items():
        for row in part.execute(f"SELECT * FROM {table}"):
            USED.add(f"row of {table}")
            values = [row[name] for name in columns.split()]
            if table == "hot" and row["base"] is None:
                values[6] = 0
            if table == "clock":
                values[4:] = [0, 0] if row["robot_us"] is None else [1, row["robot_us"]]
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
    data = struct.pack("<BIQqqI", SOURCES[source], session, seq, send, recv, len(header)) + header + body
    value = 0xCBF29CE484222325
    for byte in data:
        value = ((value ^ byte) * 0x100000001B3) & MASK
    return value


def check_manifest(part, robot, source, moved):
    hours = {}
    for session, answer in moved:
        hour = answer[2] // 3_600_000_000 * 3_600_000_000
        rows, total = hours.get(hour, (0, 0))
        hours[hour] = (rows + 1, (total + row_hash(source, session, answer)) & MASK)
    rows = part.execute("SELECT * FROM manifest WHERE robot = ? AND source = ?", (robot, SOURCES[source]))
    need({r["hour_us"]: (r["rows"], r["hash"] & MASK) for r in rows} == hours, "manifest")


# Parts and the folder


def part_answers(path, robot, source):
    """(place, session, answer) of a part, in order."""
    part = sqlite3.connect(f"file:{path}?mode=ro", uri=True, isolation_level=None)
    part.row_factory = sqlite3.Row
    need(part.execute("PRAGMA application_id").fetchone()[0] == 0x54414348, "not a part")
    need(part.execute("PRAGMA user_version").fetchone()[0] == 1, "another version")
    part.execute("BEGIN")
    check_rows(part)
    check_seals(part, part.execute("SELECT closed FROM part").fetchone()[0])
    number = part.execute("SELECT value FROM code WHERE list = 'source' AND name = ?", (source,)).fetchone()[0]
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
