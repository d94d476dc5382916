"""A second host: a namespace of the network behind a cable that a test can cut. Only this machine can reach it."""

import itertools
import os
import shutil
import subprocess

import pytest

_NUMBER = itertools.count()


def _ip(*words):
    subprocess.run(["ip", *words], check=True, capture_output=True)


class Cable:
    """Two addresses, `here` of this host and one of the namespace `name`, joined by a pair of virtual interfaces."""

    def __init__(self):
        number = next(_NUMBER)
        self.name = f"rig{os.getpid()}-{number}"
        self._near, self._far = f"ra{os.getpid()}{number}", f"rb{os.getpid()}{number}"
        network = f"10.231.{os.getpid() % 250}.{4 * (number % 60)}".rpartition(".")
        self.here, there = (f"{network[0]}.{int(network[2]) + i}" for i in (1, 2))
        if shutil.which("ip") is None:
            pytest.skip("there is no command ip here")
        try:
            _ip("netns", "add", self.name)
        except subprocess.CalledProcessError as fault:
            pytest.skip(f"no namespace may be made here: {fault.stderr.decode().strip()}")
        _ip("link", "add", self._near, "type", "veth", "peer", "name", self._far, "netns", self.name)
        _ip("addr", "add", f"{self.here}/30", "dev", self._near)
        _ip("link", "set", self._near, "up")
        _ip("-n", self.name, "addr", "add", f"{there}/30", "dev", self._far)
        _ip("-n", self.name, "link", "set", "lo", "up")
        self.join()

    @property
    def inside(self):
        """Words before a command that is to run on the other host."""
        return ["ip", "netns", "exec", self.name]

    def cut(self):
        _ip("-n", self.name, "link", "set", self._far, "down")

    def join(self):
        _ip("-n", self.name, "link", "set", self._far, "up")

    def remove(self):
        _ip("netns", "del", self.name)  # and the interfaces with it
