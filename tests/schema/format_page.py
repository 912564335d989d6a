"""What other_reader.py takes from the tables of schema/store/block/FORMAT.md: where a table is wrong, it reads wrongly."""

import os
import re

PAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../schema/store/block/FORMAT.md")
with open(PAGE, encoding="utf-8") as page:
    TEXT = page.read()


def found(pattern, text=TEXT):
    return re.search(pattern, text, re.S).groups()


def hexadecimal(pattern):
    return [int(number, 16) for number in found(pattern)]


def rows(title):
    """Cells of the lines of the first table behind a title or the words before a table."""
    cells = []
    for line in TEXT[TEXT.index(title) :].split("\n")[1:]:
        if line.startswith("|"):
            cells.append([cell.strip() for cell in line.strip("|").split(" | ")])
        elif cells:
            break
    return [cells[0]] + cells[2:]


def numbered(text):
    """'0 constant, 1 numbers' as {'constant': 0, 'numbers': 1}."""
    return {name.strip("` "): int(number) for number, name in re.findall(r"(\d+) ([^,;|(]+)", text)}


VERSION, BLOCK_VERSION = (int(n) for n in found(r"`PRAGMA user_version` is (\d+), the version byte of a block is (\d+)"))
APPLICATION, = hexadecimal(r"`PRAGMA application_id` is (0x\w+)")
CRC_POLYNOMIAL, CRC_START, CRC_EXAMPLE = hexadecimal(r"polynomial (0x\w+) .*?start (0x\w+),.*?`123456789`: (0x\w+)")
FNV_START, FNV_FACTOR = hexadecimal(r"start (0xC\w+), per byte: XOR, then times (0x\w+)\)")
ZSTD_MAGIC = bytes.fromhex(found(r"4 magic bytes \(([0-9A-F ]+)\)")[0])

SOURCES = {name.strip("`"): int(number) for number, name in zip(*rows("Sources, in code list"))}
HOT_FLAGS = {row[0]: int(row[2][5:]) for row in rows("First the numbers of each answer") if row[2].startswith("flag ")}

SIZES = {"u8": "B", "u32": "I", "u64": "Q", "i64": "q", "8": "8s"}
HEAD = {row[2]: (int(row[0]), SIZES[row[1]]) for row in rows("### Head")[1:]}
HEAD_BYTES = int(found(r"\| head \| (\d+) \|")[0])
ROW_COLUMNS = {row[1].strip("`"): int(row[0]) for row in rows("### Columns\n")[1:8]}
FORMS = numbered(found(r"\| form \| u8 \| always \| (.*?)\n")[0])

PREDICTION_BITS, SPARSE, ONE_BY_ONE, PLANES = (
    int(n) for n in found(r"bits 0, (\d): prediction; bit (\d): sparse; bit (\d): planes one by one; bits (\d) to 7")
)
KINDS = {}
for row in rows("A style turns each integer")[1:]:
    KINDS.update({name: int(number) for number, name in zip(row[0].split(", "), row[1].split(", "))})
REAL_FLAGS = numbered(found(r"u8 flags: ([^;]+);")[0])
POINTED_DECIMAL = hexadecimal(r"u8 decimals, plus (0x\w+)")[0]
ORDERS = {
    int(number): ["ABCD".index(letter) for letter in letters.split()]
    for number, letters in re.findall(r"(\d) ([A-D] [A-D] [A-D] [A-D])", TEXT)
}

COVERED = {
    table: [name.split(" ")[0] for name in names.replace("(0 for NULL)", "").split(", ")]
    for table, names in re.findall(r"\| `(hot|block)\.crc` \| ([^|]+?) \|", TEXT)
}
HASHED = [
    (name, int(size))
    for name, size in re.findall(
        r"(\w+)(?: of the header)? \((\d)(?: byte)?\)", found(r"\), over (source.*?header, body)")[0]
    )
]
