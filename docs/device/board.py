"""A board in Python over UDP: normal-force feedback, as of the scene belt_normal_force. python board.py [PORT]

It needs nothing of friction-rig. On MicroPython connect the network first and use "0.0.0.0" as host.
"""

import socket
import struct
import sys

VERSION, STEP, START, ECHO, ACT, UNSTARTED, ECHOED = 0x71, 1, 2, 3, 0x11, 0x12, 0x13
HEAD = "<BBBBIq"  # version, kind, number of values, bytes of a value, sequence, time [ns]
NOMINAL, GAIN, HIGHEST, ENABLE_NS = 20.0, 200.0, 100.0, 4000000000


def law(state, t_ns, values):
    """The next state and the commands of one step; `state` is None at the start. Replace it by your own."""
    v = values[0]
    smooth = v if state is None else state
    smooth += v - smooth
    force = NOMINAL - GAIN * smooth if t_ns >= ENABLE_NS else NOMINAL
    return smooth, (min(max(force, 0.0), HIGHEST),)


class Board:
    """Answers frames; a repeated frame is answered from memory."""

    def __init__(self):
        self.state, self.started, self.last, self.said = None, False, None, b""

    def answer(self, frame):
        """The answer to a frame; empty without one."""
        if len(frame) < 16 or frame[0] != VERSION:
            return b""
        _, kind, count, width, sequence, t_ns = struct.unpack_from(HEAD, frame)
        if width not in (4, 8) or len(frame) != 16 + count * width:
            return b""
        if kind == ECHO:
            return frame[:1] + bytes([ECHOED]) + frame[2:]
        if (sequence, t_ns) != self.last and kind in (STEP, START):
            letter = "d" if width == 8 else "f"
            values = struct.unpack_from("<" + letter * count, frame, 16)
            if kind == START:
                self.state, self.started = None, True
            commands = ()
            if self.started:
                self.state, commands = law(self.state, t_ns, values)
            kind = ACT if self.started else UNSTARTED
            self.said = struct.pack(HEAD, VERSION, kind, len(commands), width, sequence, t_ns)
            self.said += struct.pack("<" + letter * len(commands), *commands)
            self.last = sequence, t_ns
        return self.said


def main():
    """Answer datagrams until Ctrl-C."""
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", int(sys.argv[1]) if len(sys.argv) > 1 else 5005))
    board = Board()
    print("ready")  # noqa: T201
    if hasattr(sys.stdout, "flush"):  # MicroPython has none
        sys.stdout.flush()
    while True:
        frame, who = link.recvfrom(2048)
        said = board.answer(frame)
        if said:
            link.sendto(said, who)


if __name__ == "__main__":
    main()
