"""Ports for tests: each belongs to the process that asked for it, for as long as that process lives."""

import random
import socket

RANGE = (15_000, 32_000)
"""Below the ports that Linux gives to connections (from 32768): one of those may be taken before it is listened on."""

_DRAW = random.SystemRandom()
_HELD = []


def own_port(count=1):
    """The first of `count` ports in a row that nothing uses, and that no other test takes."""
    while True:
        first = _DRAW.randrange(*RANGE)
        held = []
        try:
            for number in range(first, first + count):
                held.append(_hold(number))
                for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
                    with socket.socket(socket.AF_INET, kind) as tried:
                        tried.bind(("127.0.0.1", number))
        except OSError:
            for name in held:
                name.close()
            continue
        _HELD.extend(held)
        return first


def _hold(number):
    """A name in the namespace of this host, which only one process can bind: tests run in several at once."""
    name = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        name.bind(f"\0friction-rig-test-port-{number}")
    except OSError:
        name.close()
        raise
    return name
