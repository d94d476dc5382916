"""A run with tickets, and the processes of other hosts."""

import os
import subprocess
import sys
from pathlib import Path

from going import Going
from ports import own_port

from rig import scenes
from rig.bus.tickets import Listener

SCENE = "belt_normal_force"
SEATS = ("nf", "recorder", "viewer", "operator")


class Elsewhere:
    """Starts commands as on another host; `before`: words before each, which put it into a namespace."""

    def __init__(self, folder, before=()):
        self.folder = folder
        self.before = [*before]
        self.started = []
        (folder / "runtime").mkdir(mode=0o700)

    def rig(self, *words):
        """A process of `rig`; its output is in `process.told`."""
        out = self.folder / f"{len(self.started)}.out"
        environment = {**os.environ, "XDG_RUNTIME_DIR": str(self.folder / "runtime"), "PYTHONUNBUFFERED": "1"}
        with out.open("w") as file:
            process = subprocess.Popen(
                [*self.before, sys.executable, "-m", "rig", *map(str, words)],
                stdout=file,
                stderr=subprocess.STDOUT,
                env=environment,
                cwd=self.folder,
            )
        process.told = out
        self.started.append(process)
        return process

    def asked(self, *words):
        """Exit code and output of a command that ends."""
        process = self.rig(*words)
        return process.wait(60.0), process.told.read_text()

    def end(self):
        for process in self.started:
            if process.poll() is None:
                process.kill()
            process.wait(10.0)


class RemoteRun(Going):
    """A supervised run with tickets. `tickets`: copies that outlast it, by seat."""

    def __init__(self, folder, host="127.0.0.1", seats=SEATS, **options):
        self.endpoint = f"tls/{host}:{own_port()}"
        self.interrupts = []
        listener = Listener(self.endpoint, seats, 60.0)
        super().__init__(scenes.load(SCENE), listener=listener, interrupts=self.interrupts, **options)
        self.line("listens at ")
        where = next(line for line in self.lines if line.startswith("listens at "))
        given = Path(where.partition("tickets in ")[2].partition(":")[0])
        self.tickets = {}
        for seat in seats:
            self.tickets[seat] = folder / f"{seat}.ticket"
            self.tickets[seat].touch(mode=0o600)
            self.tickets[seat].write_text((given / f"{seat}.ticket").read_text())
