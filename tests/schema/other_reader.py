#!/usr/bin/env python3
"""Reads the answers of a log by schema/store/block/FORMAT.md alone: other_reader.py LOG ROBOT SOURCE

Prints a line per answer: session, seq, t_send_us, t_recv_us, frame header and body (both hex, - when empty). Sums of the
manifest are made again; what does not fit is an error.
"""
import ctypes
import ctypes.util
import pathlib
import sqlite3
import struct
import sys

M64 = (1 << 64) - 1
SOURCES = ["status", "io", "registers", "inputs", "pose", "push", "ring"]


def load_zstd():
    name = ctypes.util.find_library("zstd") or "libzstd.so.1"
    lib = ctypes.CDLL(name)
    lib.ZSTD_createDCtx.restype = ctypes.c_void_p
    lib.ZSTD_DCtx_refPrefix.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t]
    lib.ZSTD_DCtx_refPrefix.restype = ctypes.c_size_t
    lib.ZSTD_decompressDCtx.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_char_p, ctypes.c_size_t]
    lib.ZSTD_decompressDCtx.restype = ctypes.c_size_t
    return lib


try:
    ZSTD = load_zstd()
except OSError:
    print("no libzstd", file=sys.stderr)
    sys.exit(77)
CONTEXT = ZSTD.ZSTD_createDCtx()


def unframe(stored, size, prefix=b""):
    frame = b"\x28\xb5\x2f\xfd" + stored
    out = ctypes.create_string_buffer(max(size, 1))
    if prefix:
        ZSTD.ZSTD_DCtx_refPrefix(CONTEXT, prefix, len(prefix))
    got = ZSTD.ZSTD_decompressDCtx(CONTEXT, out, size, frame, len(frame))
    assert got == size, "a frame is not what it should be"
    return out.raw[:size]


def crc_table():
    table = []
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
        table.append(crc)
    return table


CRC = crc_table()


def crc(data):
    state = 0xFFFFFFFF
    for byte in data:
        state = state >> 8 ^ CRC[(state ^ byte) & 0xFF]
    return state ^ 0xFFFFFFFF


def signed64(value):
    value &= M64
    return value - (1 << 64) if value >> 63 else value


def unzigzag(value):
    return value >> 1 ^ -(value & 1)


class Reader:
    def __init__(self, data):
        self.data = data
        self.at = 0

    def take(self, count):
        assert self.at + count <= len(self.data), "bytes are missing"
        self.at += count
        return self.data[self.at - count:self.at]

    def u8(self):
        return self.take(1)[0]

    def fixed(self, code):
        return struct.unpack("<" + code, self.take(struct.calcsize("<" + code)))[0]

    def varint(self):
        value = shift = 0
        while True:
            byte = self.u8()
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    def signed(self):
        return unzigzag(self.varint())

    def rest(self):
        return self.take(len(self.data) - self.at)

    def piece(self, size):
        head = self.varint()
        stored = self.take(head // 2)
        content = unframe(stored, size) if head % 2 else stored
        assert len(content) == size
        return content

    def texts(self, count):
        inner = Reader(self.piece(self.varint()))
        lengths = [inner.varint() for _ in range(count)]
        return [inner.take(length) for length in lengths]

    def integers(self, count):
        if count == 0:
            return []
        flags = self.u8()
        low = self.u8()
        prediction, planes = flags & 3, flags >> 4
        base = self.signed()
        slope = self.signed() if prediction >= 2 else 0
        places = range(count)
        if flags & 4:
            bitmap = self.piece((count + 7) // 8)
            places = [i for i in range(count) if bitmap[i // 8] >> (i % 8) & 1]
        n = len(places)
        low_bits = int.from_bytes(self.take((n * low + 7) // 8), "little")
        if flags & 8:
            plane = [self.piece(n) for _ in range(planes)]
        else:
            together = self.piece(planes * n) if planes else b""
            plane = [together[p * n:(p + 1) * n] for p in range(planes)]
        residuals = [0] * count
        for k, place in enumerate(places):
            high = sum(plane[p][k] << 8 * p for p in range(planes))
            residuals[place] = high << low | low_bits >> k * low & (1 << low) - 1
        values = []
        value, step = (base, 0) if prediction == 1 else (base - slope, slope)
        for i, residual in enumerate(residuals):
            residual &= M64
            if prediction == 0:
                values.append(signed64(base + residual))
            elif prediction == 3:
                values.append(signed64(base + residual + (signed64(i * slope) >> 16)))
            else:
                step = (step if prediction == 2 else 0) + unzigzag(residual)
                value += step
                values.append(signed64(value))
        return values


class Style:
    def __init__(self, reader):
        self.kind = reader.u8()
        self.decimals = 0
        if self.kind == 0:
            first = reader.u8()
            self.decimals, self.point = first & 0x7F, bool(first & 0x80)
            self.least, self.width = reader.u8(), reader.u8()
        elif self.kind in (1, 2):
            self.flags, self.digits = reader.u8(), reader.u8()
            self.first, self.last = reader.fixed("b"), reader.fixed("b")
        elif self.kind in (4, 5, 6):
            self.order, self.decimals = reader.u8(), reader.u8()

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
            size = -value - 1 if value < 0 else value
            number = size / 10 ** self.decimals
            bits = struct.unpack("<I", struct.pack("<f", -number if value < 0 else number))[0]
        high = struct.pack(">I", bits)
        return bytes(high[i] for i in ((2, 3, 0, 1), (0, 1, 2, 3), (1, 0, 3, 2), (3, 2, 1, 0))[self.order])

    def decimal(self, value):
        if self.point and value == -1:
            return b"-0.0"
        size = str(-value - 1 if value < 0 else value).rjust(self.decimals + self.width, "0")
        whole, fraction = size[:len(size) - self.decimals], size[len(size) - self.decimals:]
        while len(fraction) > self.least and fraction.endswith("0"):
            fraction = fraction[:-1]
        return (("-" if value < 0 else "") + whole + ("." + fraction if fraction else "")).encode()

    def real(self, value):
        if self.kind == 1:
            number = struct.unpack("<d", struct.pack("<q", value))[0]
        else:
            number = struct.unpack("<f", struct.pack("<I", value & 0xFFFFFFFF))[0]
        negative = struct.pack(">d", number)[0] >> 7
        if self.flags & 1 and number == 0 and negative:
            return b"-0.0"
        size = abs(number)
        as_float = self.kind == 2 and self.digits == 1
        scientific = self.scientific(size, as_float)
        mantissa, exponent = scientific.split("e")
        digits = mantissa.replace(".", "").rstrip("0") or "0"
        point = int(exponent) + 1
        if self.flags & 2:
            fixed = str(int(size)) if size == int(size) else self.fixed(digits, point)
            short = digits[0] + ("." + digits[1:] if len(digits) > 1 else "") + "e%+03d" % (point - 1)
            text = fixed if len(fixed) <= len(short) else short
        elif self.first <= point <= self.last:
            text = self.fixed(digits, point) + (".0" if self.flags & 16 and len(digits) <= point else "")
        else:
            text = digits[0] + ("." + digits[1:] if len(digits) > 1 else "") + "e"
            power = point - 1
            text += "-" if power < 0 else "+" if self.flags & 8 else ""
            text += str(abs(power)).rjust(2 if self.flags & 4 else 1, "0")
        return (("-" if negative else "") + text).encode()

    def scientific(self, size, as_float):
        if self.digits > 1:
            return "%.*e" % (self.digits - 1, size)
        for significant in range(1, 18):
            text = "%.*e" % (significant - 1, size)
            back = struct.unpack("<f", struct.pack("<f", float(text)))[0] if as_float else float(text)
            if back == size:
                return text
        return text

    @staticmethod
    def fixed(digits, point):
        if point <= 0:
            return "0." + "0" * -point + digits
        return digits[:point].ljust(point, "0") + ("." + digits[point:] if len(digits) > point else "")


class Entry:
    def __init__(self, reader, constants):
        self.form = reader.u8()
        self.children = []
        self.length = 0
        if self.form == 0:
            self.constant = next(constants)
            return
        self.count, self.length, self.crc = reader.varint(), reader.varint(), reader.fixed("I")
        if self.form == 1:
            self.exceptions = reader.varint()
            self.style = Style(reader)
            for _ in range(4):
                reader.fixed("q") if self.style.kind == 1 else reader.varint()
        elif self.form == 3:
            self.children = [Entry(reader, constants) for _ in range(reader.varint())]

    def bytes(self):
        return self.length + sum(child.bytes() for child in self.children)

    def place(self, offset):
        self.offset = offset
        offset += self.length
        for child in self.children:
            offset = child.place(offset)
        return offset


def chosen(reader, count):
    distinct = reader.varint()
    texts = reader.texts(distinct)
    return [texts[i] for i in reader.integers(count)] if distinct > 1 else texts * count


class Block:
    def __init__(self, blob):
        self.blob = blob
        head = struct.unpack_from("<8sBBBBIQIIIIIQQqq", blob)
        assert head[0] == b"TACHOBLK" and head[1] == 1
        self.source, self.session, self.rows = head[2], head[9], head[10]
        directory = blob[76:76 + head[7]]
        assert head[5] == crc(blob[:12] + blob[16:76] + directory) and head[6] == len(blob)
        reader = Reader(directory)
        self.columns, entries = reader.varint(), reader.varint()
        offset = 76 + len(directory)
        frames = []
        for _ in range(2):
            count, length, total = reader.varint(), reader.varint(), reader.fixed("I")
            frame = blob[offset:offset + length]
            assert crc(frame) == total
            offset += length
            frames.append(Reader(frame).texts(count))
        self.shapes, self.constants = frames
        constants = iter(range(self.columns - entries, len(self.constants)))
        self.entries = {}
        position = 0
        for _ in range(entries):
            position += reader.varint()
            self.entries[position] = Entry(reader, constants)
            position += 1
        for entry in sorted(self.entries.values(), key=lambda e: e.bytes()):
            offset = entry.place(offset)
        assert offset == len(blob) and reader.at == len(directory)
        self.constant_columns = [c for c in range(self.columns) if c not in self.entries]

    def frame(self, entry):
        frame = self.blob[entry.offset:entry.offset + entry.length]
        assert crc(frame) == entry.crc
        return Reader(frame)

    def integers(self, column):
        entry = self.entries[column]
        assert entry.form == 1 and entry.exceptions == 0
        return self.frame(entry).integers(entry.count)

    def texts(self, column, count):
        if column not in self.entries:
            return [self.constants[self.constant_columns.index(column)]] * count
        assert self.entries[column].count == count
        return self.texts_of(self.entries[column], count)

    def texts_of(self, entry, count):
        if entry.form == 0:
            return [self.constants[entry.constant]] * count
        reader = self.frame(entry)
        if entry.form == 2:
            return chosen(reader, count)
        if entry.form == 3:
            pieces = reader.texts(1)[0].split(b"\0")
            parts = [self.texts_of(child, count) for child in entry.children]
            return [b"".join(p + parts[k][i] for k, p in enumerate(pieces[:-1])) + pieces[-1] for i in range(count)]
        places = exceptions = []
        if entry.exceptions:
            places = reader.integers(entry.exceptions)
            exceptions = chosen(reader, entry.exceptions)
        texts = [None] * count
        for place, text in zip(places, exceptions):
            texts[place] = text
        return [entry.style.text(v) if t is None else t for v, t in zip(reader.integers(count), texts)]

    def answers(self):
        seq, send, trip, shape = (self.integers(c) for c in range(4))
        headers = self.texts(4, self.rows)
        raw = iter(self.texts(5, shape.count(0)) if 0 in shape else [])
        place = self.integers(6)
        take = register_shape if SOURCES[self.source] in ("registers", "inputs") else json_shape
        shapes, known = [], {}
        for text in self.shapes:
            pieces, paths = take(text)
            seen, columns = {}, []
            for path in paths:
                nth = seen[path] = seen.get(path, -1) + 1
                columns.append(known.setdefault((path, nth), len(known)))
            shapes.append((pieces, columns))
        assert 7 + len(known) == self.columns
        counts = [0] * len(known)
        for number in shape:
            for column in shapes[number - 1][1] if number else []:
                counts[column] += 1
        leaves = [iter(self.texts(7 + column, count)) for column, count in enumerate(counts)]
        for row in range(self.rows):
            if shape[row] == 0:
                body = next(raw)
            else:
                pieces, columns = shapes[shape[row] - 1]
                body = b"".join(p + next(leaves[c]) for p, c in zip(pieces, columns)) + pieces[-1]
            yield place[row], self.session, seq[row], send[row], send[row] + trip[row], headers[row], body


def json_shape(shape):
    """Pieces between the holes, and the path of each hole."""
    paths, keys, at, key = [], [], 0, None
    escapes = {98: "\b", 102: "\f", 110: "\n", 114: "\r", 116: "\t"}
    while at < len(shape):
        c = shape[at]
        if c == 0x22:  # only keys are left in a shape
            text = ""
            at += 1
            start = at
            while shape[at] != 0x22:
                if shape[at] != 0x5C:
                    at += 1
                    continue
                text += shape[start:at].decode()
                at += 1
                if shape[at] == 0x75:
                    text += chr(int(shape[at + 1:at + 5], 16))
                    at += 4
                else:
                    text += escapes.get(shape[at], chr(shape[at]))
                at += 1
                start = at
            text += shape[start:at].decode()
            key = text.encode("utf-16", "surrogatepass").decode("utf-16").replace("\\", "\\\\").replace(".", "\\.")
        elif c == 0x7B:
            keys.append(key)
        elif c == 0x7D:
            keys.pop()
        elif c == 0:
            paths.append(".".join(keys[1:] + [key]))
        at += 1
    return shape.split(b"\0"), paths


def register_shape(shape):
    sizes = {0x77: (2, 1), 0x69: (4, 2), 0x66: (4, 2), 0x62: (1, 8)}
    pieces, paths, at = [b""], [], 0
    while at < len(shape):
        address, count = struct.unpack_from(">HH", shape, at)
        pieces[-1] += shape[at:at + 4]
        at += 4
        end = address + count
        left = (count + 7) // 8 if at < len(shape) and shape[at] == 0x62 else 2 * count
        while left > 0:
            size, addresses = sizes[shape[at]]
            paths.append((address, min(address + addresses, end)))
            pieces.append(b"")
            left -= size
            address += addresses
            at += 1
    return pieces, paths


class Hot:
    """The rows of one part; bases are read when they are needed."""

    def __init__(self, part):
        self.part = part
        self.bodies = {}

    def answers(self, robot, source):
        ids = self.part.execute("SELECT id FROM hot WHERE robot = ? AND source = ? ORDER BY id", (robot, source))
        for row, in ids.fetchall():
            yield from self.row(row)

    def row(self, number):
        columns = "id, robot, source, session, seq, t_send_us, base, rows, crc, data"
        row = self.part.execute(f"SELECT {columns} FROM hot WHERE id = ?", (number,)).fetchone()
        place, robot, source, session, seq, send, base, rows, total, data = row
        fixed = struct.pack("<9q", place, robot, source, session, seq, send, base or 0, rows, len(data))
        assert crc(fixed + data) == total & 0xFFFFFFFF
        before = self.last_body(base) if base is not None else b""
        reader = Reader(data)
        marks, distance, trip, length = [], 0, 0, 0
        for i in range(rows):
            flags = reader.u8()
            if i:
                place += 1 + reader.varint()
                seq += 1
            seq += reader.varint() if flags & 8 else 0
            distance += reader.signed() if flags & 16 else 0
            send += distance if i else 0
            trip += reader.signed()
            length += reader.signed() if flags & 2 else 0
            header = reader.take(reader.varint()) if flags & 4 else b""
            marks.append((flags & 1, length, (place, session, seq, send, send + trip, header)))
        stored = [length for repeats, length, _ in marks if not repeats]
        bodies = self.unpack(reader, stored, [m[1] for m in marks], before, base is not None)
        body = before
        out = []
        for repeats, _, numbers in marks:
            body = body if repeats else next(bodies)
            out.append(numbers + (body,))
        self.bodies[number] = body
        return out

    def last_body(self, number):
        if number not in self.bodies:
            self.row(number)
        return self.bodies[number]

    @staticmethod
    def unpack(reader, stored, lengths, base, based):
        if not stored:
            return iter([])
        size = sum(stored)
        method = reader.u8()
        data = reader.rest()
        if method == 1:
            data = unframe(data, size, base)
        elif method == 2:
            turned, n, length = unframe(data, size), len(stored), lengths[0]
            bodies, last = [], base if based else bytes(length)
            for k in range(n):
                last = bytes((last[i] + turned[i * n + k]) & 0xFF for i in range(length))
                bodies.append(last)
            return iter(bodies)
        assert len(data) == size
        out, at = [], 0
        for length in stored:
            out.append(data[at:at + length])
            at += length
        return iter(out)


def fnv(data):
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 & M64
    return value


def check_manifest(part, robot, source, answers):
    sums = {}
    for _, session, seq, send, recv, header, body in answers:
        hashed = fnv(struct.pack("<BIQqqI", source, session, seq, send, recv, len(header)) + header + body)
        rows, total = sums.get(send // 3_600_000_000, (0, 0))
        sums[send // 3_600_000_000] = (rows + 1, total + hashed & M64)
    told = part.execute("SELECT hour_us, rows, hash FROM manifest WHERE robot = ? AND source = ?", (robot, source))
    assert sums == {hour // 3_600_000_000: (rows, total & M64) for hour, rows, total in told}, "not what was received"


def main(log, robot, source):
    robot, number = int(robot), SOURCES.index(source)
    parts = []
    for path in sorted(pathlib.Path(log).glob("part-*.db")):
        part = sqlite3.connect(path)
        assert part.execute("PRAGMA application_id").fetchone()[0] == 0x54414348
        assert part.execute("PRAGMA user_version").fetchone()[0] == 1
        parts.append((part.execute("SELECT number FROM part").fetchone()[0], part))
    for _, part in sorted(parts, key=lambda p: p[0]):
        blocks = part.execute("SELECT data FROM block WHERE robot = ? AND source = ?", (robot, number))
        packed = [answer for blob, in blocks for answer in Block(blob).answers()]
        check_manifest(part, robot, number, packed)
        for _, session, seq, send, recv, header, body in sorted(packed + list(Hot(part).answers(robot, number))):
            print(session, seq, send, recv, header.hex() or "-", body.hex() or "-")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
