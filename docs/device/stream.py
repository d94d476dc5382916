"""A data acquisition in Python over UDP: the speed of a real belt, a frame each millisecond. python stream.py [PORT]

It needs nothing of friction-rig. On MicroPython connect the network first, name the computer of the run as RIG, and
take 1e-6 * time.ticks_us() in place of time.time(), which counts whole seconds there.
"""

import math
import socket
import struct
import sys
import time

VERSION, MEASURED = 0x71, 0x14
HEAD = "<BBBBIq"  # version, kind, number of values, bytes of a value, sequence, time [ns]
RIG = "127.0.0.1"


def measured(t):
    """The values at time t [s], in SI units. Read your sensors here."""
    return (0.1 + 0.02 * math.sin(2.0 * math.pi * t),)


def frame(sequence, t):
    """The frame with the values at time t [s]."""
    values = measured(t)
    head = struct.pack(HEAD, VERSION, MEASURED, len(values), 8, sequence & 0xFFFFFFFF, int(t * 1e9))
    return head + struct.pack("<" + "d" * len(values), *values)


def main():
    """Send frames until Ctrl-C."""
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 5007
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("0.0.0.0", port))
    print("ready")  # noqa: T201
    if hasattr(sys.stdout, "flush"):  # MicroPython has none
        sys.stdout.flush()
    sequence = 0
    begun = time.time()
    while True:
        sequence += 1
        link.sendto(frame(sequence, time.time() - begun), (RIG, port + 1))
        time.sleep(max(begun + 0.001 * sequence - time.time(), 0.0))


if __name__ == "__main__":
    main()
