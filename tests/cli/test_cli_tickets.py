"""Commands on another computer than the plant's, each with --ticket and with RIG_TICKET, and what they refuse."""

import json
import socket
import threading

import pytest
from ports import own_port

from rig import bus, scenes
from rig.bench.live.outcome import Job
from rig.bench.live.plant import Plant
from rig.bus import tickets
from rig.bus.tickets import Listener

pytest.importorskip("cryptography")


class Far:
    """A run in this process, whose host is another one for the commands: they have a directory of runs of their own."""

    def __init__(self, folder, monkeypatch, rig):
        scene = scenes.load("belt")
        self.listener = Listener(f"tls/127.0.0.1:{own_port()}", ("recorder", "viewer", "operator"))
        self.session = bus.host("far", scene.name, None, [], self.listener)
        self.stopped = []
        job = Job(scene.to_json(), run="far", pace=1.0, duration=600.0, listener=self.listener)
        plant = Plant(self.session, job, lambda: "by the test" if self.stopped else "")
        self.session.announce()
        self.folder = folder
        for seat, ticket in self.session.tickets.items():
            self.ticket(seat).touch(mode=0o600)
            self.ticket(seat).write_text(ticket.read_text())
        self.thread = threading.Thread(target=self._run, args=(plant,))
        self.thread.start()
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
        self._monkeypatch = monkeypatch
        self._rig = rig

    def _run(self, plant):
        plant.run(lambda _: None)
        self.session.close()

    def ticket(self, seat):
        return self.folder / f"{seat}.ticket"

    def asked(self, *words, seat="operator", how="option"):
        """Exit code and output of a command with the ticket of a seat, as an option or in the environment."""
        with self._monkeypatch.context() as patch:
            more = ["--ticket", str(self.ticket(seat))] if how == "option" else []
            if not more:
                patch.setenv("RIG_TICKET", str(self.ticket(seat)))
            code, output, told = self._rig(*words, *more)
        return code, output + told

    def end(self):
        self.stopped.append(True)
        self.thread.join(60.0)


@pytest.fixture
def far(runs, tmp_path, monkeypatch, rig):
    made = Far(tmp_path, monkeypatch, rig)
    yield made
    made.end()


@pytest.mark.parametrize("how", ["option", "environment"])
def test_each_command_of_an_operator(far, how):
    told = {
        ("live", "tune"): "load.force",
        ("live", "tune", "load.force", "15 N"): "load.force = 15",
        ("live", "topic", "ls", "--for", "0.1"): "state",
        ("live", "topic", "hz", "state", "--for", "0.1"): "state",
        ("live", "topic", "echo", "state", "--count", "1"): '"topic": "state"',
        ("live", "pause"): "paused at t = ",
        ("live", "step", "--frames", "2"): "2 single steps from t = ",
        ("live", "resume"): "continues from t = ",
        ("live", "knock", "0.001"): "knock with 0.001 N s at t = ",
        ("live", "stop"): "stopped at t = ",
    }
    for words, text in told.items():
        code, output = far.asked(*words, how=how)
        assert code == 0, (words, output)
        assert text in output
    far.thread.join(60.0)
    assert not far.thread.is_alive()


COMMANDS = {
    "operator": [["live", "tune"], ["live", "topic", "ls"], ["live", "stop"], ["web", "--no-open"]],
    "recorder": [["live", "record"]],
    "viewer": [["view", "--save", "x.rrd"]],
}


@pytest.mark.parametrize(("seat", "words"), [(seat, words) for seat, of in COMMANDS.items() for words in of])
def test_each_command_refuses_what_opens_nothing_in_one_line(far, seat, words, monkeypatch):
    """Exit code 2 and the reason: the ticket of another seat, readable by others, damaged, of a run that has ended."""
    monkeypatch.setattr("rig.bus.link.CONNECT_MS", 500)  # a host that refuses a password does not say so
    other = next(name for name in COMMANDS if name != seat)
    refused = {f"is the ticket of {other}": far.asked(*words, seat=other)}
    path = far.ticket(seat)
    path.chmod(0o640)
    refused["can be read by others"] = far.asked(*words, seat=seat)
    path.chmod(0o600)
    text = path.read_text()
    path.write_text(text[:-30])
    refused["is damaged"] = far.asked(*words, seat=seat, how="environment")
    values = json.loads(text.partition("\n")[2])
    path.write_text(tickets.sealed(values | {"password": "wrong"}))
    refused["refuses the user, the password or the certificate"] = far.asked(*words, seat=seat)
    path.write_text(text)
    far.end()
    wait = [] if words[0] == "web" or seat == "operator" else ["--wait", "0"]
    refused["nobody listens at "] = far.asked(*words, *wait, seat=seat)
    for reason, (code, output) in refused.items():
        assert code == 2, (reason, output)
        (line,) = [line for line in output.splitlines() if line.strip()]
        assert reason in line


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--listen", "tls/127.0.0.1:443", "--tickets", "nf"), "the port must be 1024 to 65535"),
        (("--listen", "tls/0.0.0.0:7450", "--tickets", "nf"), "name the one address"),
        (("--listen", "tls/127.0.0.1:7450", "--tickets", "fn"), "the run has no such seat"),
        (("--listen", "tls/127.0.0.1:7450", "--tickets", "nf", "--tickets", "nf"), "--tickets nf: named twice"),
        (("--listen", "tls/127.0.0.1:7450"), "needs --tickets"),
        (("--listen", "", "--tickets", "nf"), "expected tls/HOST:PORT"),
        (("--tickets", ""), "needs --listen"),
        (("--tickets", "nf"), "needs --listen"),
        (("--listen", "udp/127.0.0.1:7450", "--tickets", "nf"), "expected tls/HOST:PORT"),
    ],
)
def test_rig_run_refuses_where_nobody_can_join_before_anything_starts(words, reason, runs, rig):
    code, output, told = rig("run", "belt_normal_force", *words)
    assert (code, output) == (2, "")
    (line,) = told.splitlines()
    assert reason in line


@pytest.mark.parametrize("words", [("run", "belt_normal_force", "--tickets", "nf", "--listen"), ("web", "--share")])
def test_an_address_in_use_is_refused_by_command(words, runs, rig):
    with socket.create_server(("127.0.0.1", 0)) as other:
        before = "tls/" if words[0] == "run" else ""
        place = f"{before}127.0.0.1:{other.getsockname()[1]}"
        code, output, told = rig(*words, place)
    assert (code, output) == (2, "")
    assert told.strip() == f"{words[-1]} {place}: another process listens there; choose another port"
