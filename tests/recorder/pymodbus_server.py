#!/usr/bin/env python3
"""An independent Modbus TCP server (pymodbus 3) that holds a robot's registers on a free port of 127.0.0.1.

pymodbus_server.py zero|exception REGISTERS INPUTS

REGISTERS and INPUTS are documented addresses as "1-23,25-44". What lies between them reads as 0, or is refused with
exception 2. Prints the port once it listens, and ends when standard input does.
"""
import asyncio
import struct
import sys

from pymodbus.datastore import ModbusServerContext, ModbusSlaveContext, ModbusSparseDataBlock
from pymodbus.server.async_io import ModbusTcpServer

FLOATS = {15: 24.0, 17: 52.347, 19: -1.1, 21: 53.346, 25: 24.5, 29: 875.0}
ADDRESS = {70: 127, 71: 0, 72: 0, 73: 1}


def addresses(text):
    for run in text.split(","):
        first, last = run.split("-")
        yield from range(int(first), int(last) + 1)


def block(documented, value, gaps_as_zero):
    """A documented address is sent minus one."""
    values = {a - 1: value(a) for a in documented}
    if gaps_as_zero:
        values = {a: values.get(a, 0) for a in range(max(values) + 1)}
    return ModbusSparseDataBlock(values)


def registers(documented, gaps_as_zero):
    words = {a: 1000 + a for a in documented}
    words.update(ADDRESS)
    for address, value in FLOATS.items():
        high, low = struct.unpack(">HH", struct.pack(">f", value))
        words[address], words[address + 1] = low, high
    return block(documented, lambda a: words[a], gaps_as_zero)


async def main():
    zero = sys.argv[1] == "zero"
    store = ModbusSlaveContext(
        ir=registers(list(addresses(sys.argv[2])), zero),
        di=block(list(addresses(sys.argv[3])), lambda a: int(a % 3 == 0), zero),
        zero_mode=True,
    )
    context = ModbusServerContext(slaves={1: store}, single=False)
    server = ModbusTcpServer(context, address=("127.0.0.1", 0))
    serving = asyncio.ensure_future(server.serve_forever())
    await server.serving
    print(server.server.sockets[0].getsockname()[1], flush=True)
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
    serving.cancel()


asyncio.run(main())
