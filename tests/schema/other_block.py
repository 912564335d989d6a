"""For other_reader.py: data of a hot row, data of a block."""

import json
import re
import struct

import format_page as page
from other_numbers import (
    FLOAT_BITS,
    MASK,
    REAL32,
    REAL64,
    USED,
    Bytes,
    Style,
    crc,
    distinct,
    integers,
    need,
    signed,
    texts,
    unzstd,
)

IMAGES = ("registers", "inputs")


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
            seq = (seq + 1 + (data.varint() if flags & page.HOT_FLAGS["polls"] else 0)) & MASK
        distance = signed(distance + (data.svarint() if flags & page.HOT_FLAGS["distance"] else 0))
        send = signed(send + distance) if i > 0 else send
        trip = signed(trip + data.svarint())
        length += data.svarint() if flags & page.HOT_FLAGS["length"] else 0
        header = data.take(data.varint()) if flags & page.HOT_FLAGS["header length"] else b""
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


# Data of a block: directory, columns, shapes


class Entry:
    def __init__(self, data, constants, position=None):
        self.position = position
        self.form = data.number("B")
        self.parts = []
        USED.add(f"form {self.form}")
        if self.form == page.FORMS["constant"]:
            self.constant = next(constants)
            self.length = 0
            return
        self.count, self.length, self.crc = data.varint(), data.varint(), data.number("I")
        if self.form == page.FORMS["numbers"]:
            self.exceptions = data.varint()
            self.style = Style(data)
            if self.style.kind == REAL64:
                self.statistics = [data.number("q") for _ in range(4)]
            else:
                least = data.svarint()
                self.statistics = [least] + [signed(least + data.varint()) for _ in range(3)]
        elif self.form == page.FORMS["composite"]:
            self.parts = [Entry(data, constants) for _ in range(data.varint())]
        else:
            need(self.form == page.FORMS["texts"], "form")

    def bytes(self):
        return self.length + sum(part.bytes() for part in self.parts)

    def take_frame(self, data):
        if self.form != page.FORMS["constant"]:
            self.frame = data.take(self.length)
            need(crc(self.frame) == self.crc, "crc of a frame")
        for part in self.parts:
            part.take_frame(data)

    def numbers(self):
        """The integers of a column of the rows."""
        data = Bytes(self.frame)
        values = integers(data, self.count)
        need(self.form == page.FORMS["numbers"] and data.done(), "numbers")
        self.check_statistics(values)
        return values

    def check_statistics(self, values):
        need(not values or self.statistics[2:] == [values[0], values[-1]], "first and last of a column")
        if self.style.kind not in (REAL64, REAL32, FLOAT_BITS) and values:
            need(self.statistics[:2] == [min(values), max(values)], "min and max of a column")

    def texts(self, constants, count):
        if self.form == page.FORMS["constant"]:
            return [constants[self.constant]] * count
        need(self.count == count, "count of a column")
        data = Bytes(self.frame)
        if self.form == page.FORMS["texts"]:
            out = distinct(data, count)
        elif self.form == page.FORMS["numbers"]:
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
    head = {name: struct.unpack_from("<" + form, block, at)[0] for name, (at, form) in page.HEAD.items()}
    need(head["magic"] == b"TACHOBLK" and head["version"] == page.BLOCK_VERSION and head["nothing"] == 0, "head of a block")
    end, rows, raw_rows = page.HEAD_BYTES + head["directory bytes"], head["rows"], head["raw rows"]
    need(head["bytes"] == len(block) and crc(block[:12] + block[16:end]) == head["crc"], "crc of a head")
    need(all(head[name] == row[name] for name in ("robot", "session", "rows")), "head of another stream")
    need(head["source"] == page.SOURCES[source], "source in the head")
    data, frames = Bytes(block[page.HEAD_BYTES : end]), Bytes(block[end:])
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

    names = ("seq", "t_send_us", "t_recv_us - t_send_us", "shape", "place", "header", "body")
    at = [next(c for what, c in page.ROW_COLUMNS.items() if re.split("[`:,]", what)[0] == name) for name in names]
    seq, send, trip, shape, place = (found[c].numbers() for c in at[:5])
    headers, raw = column(at[5], rows), iter(column(at[6], raw_rows))
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
    need((head["first seq"], head["last seq"]) == (first[1], last[1]), "polls in the head")
    need((head["first t_send_us"], head["last t_send_us"]) == (first[2], last[2]), "times in the head")
    need((row["row_from"], row["row_to"]) == (first[0], last[0]), "places in the row")
    need((row["t_from_us"], row["t_to_us"]) == (min(send), max(send)), "times in the row")
    return out
