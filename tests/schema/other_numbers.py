"""For other_reader.py: bytes, zstd, pieces, integers and the texts that styles make of them."""

import ctypes
import ctypes.util
import fractions
import struct
import sys

import format_page as page

MASK = (1 << 64) - 1
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
            byte = (byte >> 1) ^ (page.CRC_POLYNOMIAL if byte & 1 else 0)
        table.append(byte)
    return table


TABLE = crc_table()


def crc(data):
    state = page.CRC_START
    for byte in data:
        state = (state >> 8) ^ TABLE[(state ^ byte) & 0xFF]
    return state ^ 0xFFFFFFFF


need(crc(b"123456789") == page.CRC_EXAMPLE, "crc")


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
    frame = page.ZSTD_MAGIC + stored
    out = ctypes.create_string_buffer(max(length, 1))
    if prefix:
        ZSTD.ZSTD_DCtx_refPrefix(CONTEXT, prefix, len(prefix))
    got = ZSTD.ZSTD_decompressDCtx(CONTEXT, out, length, frame, len(frame))
    need(got == length, "zstd frame")
    return out.raw[:length]


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
    prediction, planes = flags & ((2 << page.PREDICTION_BITS) - 1), flags >> page.PLANES
    sparse, one_by_one = flags >> page.SPARSE & 1, flags >> page.ONE_BY_ONE & 1
    USED.update([f"prediction {prediction}"] + ["sparse"] * sparse + ["one by one"] * one_by_one)
    USED.update(["low bits"] * bool(low) + ["together"] * (planes > 1 and not one_by_one))
    seed = data.svarint()
    slope = data.svarint() if prediction >= 2 else 0
    stored = range(n)
    if sparse:
        bitmap = piece(data, (n + 7) // 8)
        stored = [i for i in range(n) if bitmap[i // 8] >> (i % 8) & 1]
    m = len(stored)
    low_bits = int.from_bytes(data.take((m * low + 7) // 8), "little")
    if one_by_one:
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

DECIMAL, REAL64, REAL32, WORD, BYTE, DWORD, FLOAT_BITS, FLOAT_DECIMAL = (
    page.KINDS[name] for name in "decimal real64 real32 word byte dword float_bits float_decimal".split()
)


class Style:
    def __init__(self, data):
        self.kind = data.number("B")
        need(self.kind in page.KINDS.values(), "kind of number")
        USED.add(f"kind {self.kind}")
        if self.kind == DECIMAL:
            first = data.number("B")
            self.decimals, self.pointed = first & 0x7F, bool(first & page.POINTED_DECIMAL)
            self.least, self.width = data.number("B"), data.number("B")
        elif self.kind in (REAL64, REAL32):
            self.flags, self.digits = data.number("B"), data.number("B")
            USED.update([f"digits {min(self.digits, 5)}"] + ["shorter"] * self.has("shorter"))
            self.begin, self.end = data.number("b"), data.number("b")
        elif self.kind in (DWORD, FLOAT_BITS, FLOAT_DECIMAL):
            self.order, self.decimals = data.number("B"), data.number("B")
            USED.add(f"order {self.order}")

    def text(self, value):
        if self.kind == DECIMAL:
            return self.decimal(value)
        if self.kind in (REAL64, REAL32):
            return self.real(value)
        if self.kind == WORD:
            return struct.pack(">H", value & 0xFFFF)
        if self.kind == BYTE:
            return bytes([value & 0xFF])
        bits = value & 0xFFFFFFFF
        if self.kind == FLOAT_DECIMAL:
            size = float(-value - 1 if value < 0 else value) / 10.0**self.decimals
            bits = struct.unpack("<I", struct.pack("<f", -size if value < 0 else size))[0]
        highest_first = struct.pack(">I", bits)
        return bytes(highest_first[i] for i in page.ORDERS[self.order])

    def has(self, flag):
        return bool(self.flags & page.REAL_FLAGS[flag])

    def decimal(self, value):
        if value == -1 and self.pointed:
            return b"-0.0"
        size = str(-value - 1 if value < 0 else value).rjust(self.width + self.decimals, "0")
        whole, fraction = size[: len(size) - self.decimals], size[len(size) - self.decimals :]
        while len(fraction) > self.least and fraction.endswith("0"):
            fraction = fraction[:-1]
        return (("-" if value < 0 else "") + whole + ("." + fraction if fraction else "")).encode()

    def real(self, value):
        bits = value & (MASK if self.kind == REAL64 else 0xFFFFFFFF)
        form, whole = ("<d", "<Q") if self.kind == REAL64 else ("<f", "<I")
        number = struct.unpack(form, struct.pack(whole, bits))[0]
        minus = "-" if bits >> (63 if self.kind == REAL64 else 31) else ""
        if number == 0 and minus and self.has("zero with point"):
            return b"-0.0"
        digits, p = self.digits_of(abs(number))
        if self.has("shorter"):
            text = shorter(abs(number), digits, p)
        elif self.begin <= p <= self.end:
            text = fixed(digits, p, ".0" if self.has("whole with point") else "")
        else:
            text = scientific(digits, p, self.has("plus"), 2 if self.has("padded exponent") else 1)
        return (minus + text).encode()

    def digits_of(self, number):
        """d1d2... and p of 0.d1d2... x 10^p."""
        if number == 0:
            return "0", 1
        if self.digits >= 5 and not self.has("shorter"):
            return digits_in("%.*e" % (self.digits - 1, number))
        if self.digits == 1 and self.kind == REAL32:
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
