"""A server of the bench in a folder of its own, and a client that has opened its page."""

import json
import threading
import time
from contextlib import ExitStack, suppress

import httpx
import psutil
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from rig.web.server import Server


class Client:
    """What a page does, without a browser."""

    def __init__(self, server):
        self.server = server
        self.base = f"http://127.0.0.1:{server.port}"
        self.http = httpx.Client(base_url=self.base, follow_redirects=True, timeout=30.0)
        self.http.get(server.address)

    @property
    def cookie(self):
        return "; ".join(f"{name}={value}" for name, value in self.http.cookies.items())

    def get(self, path):
        return self.http.get(path)

    def post(self, path, **body):
        return self.http.post(path, json=body)

    def socket(self, origin=None, cookie=None, path="/live"):
        address = f"ws://127.0.0.1:{self.server.port}{path}"
        head = {"Cookie": self.cookie if cookie is None else cookie}
        return connect(address, additional_headers=head, origin=origin or self.base, open_timeout=5.0)

    def job(self, path, seconds=60.0, **body):
        """The job that a request starts, when it has ended."""
        return self.ended([self.post(path, **body).json()["number"]], seconds)[0]

    def ended(self, numbers, seconds=60.0):
        """The jobs with these numbers, when they have ended."""
        deadline = time.monotonic() + seconds
        while True:
            found = {one["number"]: one for one in self.get("/api/jobs").json()}
            jobs = [found[number] for number in numbers]
            if all(job["state"] != "working" for job in jobs):
                return jobs
            assert time.monotonic() < deadline, jobs
            time.sleep(0.1)

    def state(self):
        return self.get("/api/run").json()

    def until(self, phase, seconds=60.0):
        """The state when the run is in this phase."""
        deadline = time.monotonic() + seconds
        while (state := self.state())["phase"] != phase:
            assert time.monotonic() < deadline, state
            assert not (state["phase"] == "ended" and phase != "ended"), state
            time.sleep(0.05)
        return state


class Listener:
    """A page that reads its socket in a thread and keeps what it was told."""

    def __init__(self, client):
        self._stack = ExitStack()
        self.socket = self._stack.enter_context(client.socket())
        self.newest, self.frames, self.phases = {}, [], []
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self):
        received = 0
        with suppress(ConnectionClosed):
            for text in self.socket:
                message = json.loads(text)
                received += 1
                self.newest[message["kind"]] = message[message["kind"]]
                if message["kind"] == "state":
                    self.phases.append(message["state"]["phase"])
                if message["kind"] == "frames":
                    self.frames += message["frames"]
                self.socket.send(json.dumps({"ack": received}))

    def until(self, kind, true=lambda _: True, seconds=5.0):
        """The newest message of a kind, when it is there and `true`."""
        deadline = time.monotonic() + seconds
        while self.newest.get(kind) in (None, []) or not true(self.newest[kind]):
            assert time.monotonic() < deadline, self.newest.get(kind)
            time.sleep(0.02)
        return self.newest[kind]

    def close(self):
        self._stack.close()
        self._thread.join(5.0)
        assert not self._thread.is_alive()


@pytest.fixture
def folder(runs, tmp_path, monkeypatch):
    """A working directory with runs of its own; no process that the test has started is left."""
    monkeypatch.chdir(tmp_path)
    before = psutil.Process().children()  # a browser, which serves several tests
    yield tmp_path
    new = [one for one in psutil.Process().children() if one not in before]
    left = [*new, *(child for one in new for child in one.children(recursive=True))]
    for one in left:
        one.kill()
    psutil.wait_procs(left, 5.0)
    assert not left


@pytest.fixture
def server(folder):
    with Server(0, folder, lambda _: None) as running:
        yield running


@pytest.fixture
def client(server):
    found = Client(server)
    yield found
    found.http.close()


@pytest.fixture
def another(server):
    """A second page of the same user."""
    found = Client(server)
    yield found
    found.http.close()


@pytest.fixture
def listen(client):
    """Connects pages that read the live data."""
    started = []

    def listen():
        started.append(Listener(client))
        return started[-1]

    yield listen
    for one in started:
        one.close()
