"""A server of the bench in a folder of its own, and a client that has opened its page."""

import json
import threading
from contextlib import ExitStack, suppress

import httpx
import psutil
import pytest
from patience import PATIENCE_S, wait_for
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from rig.web.server import Server


class Client:
    """What a page does, without a browser."""

    def __init__(self, server):
        self.server = server
        self.base = f"http://127.0.0.1:{server.port}"
        self.http = httpx.Client(base_url=self.base, follow_redirects=True, timeout=PATIENCE_S)
        self.http.get(server.address)

    @property
    def cookie(self):
        return "; ".join(f"{name}={value}" for name, value in self.http.cookies.items())

    def get(self, path):
        return self.http.get(path)

    def post(self, path, **body):
        return self.http.post(path, json=body)

    def refused(self, path, **body):
        """The reason for which a request is refused."""
        answer = self.post(path, **body)
        assert answer.status_code == 422, answer.text
        return answer.json()["error"]

    def socket(self, origin=None, cookie=None, path="/live"):
        address = f"ws://127.0.0.1:{self.server.port}{path}"
        head = {"Cookie": self.cookie if cookie is None else cookie}
        return connect(address, additional_headers=head, origin=origin or self.base, open_timeout=PATIENCE_S)

    def job(self, path, **body):
        """The job that a request starts, when it has ended."""
        return self.ended([self.post(path, **body).json()["number"]])[0]

    def ended(self, numbers):
        """The jobs with these numbers, when they have ended."""

        def of_all():
            told = {job["number"]: job for job in self.get("/api/jobs").json()}
            jobs = [told[number] for number in numbers]
            return all(job["state"] != "working" for job in jobs) and jobs

        return wait_for(of_all, lambda: self.get("/api/jobs").text)

    def state(self):
        return self.get("/api/run").json()

    def command(self, do, **body):
        return self.post("/api/run/command", do=do, **body).json()

    def until(self, phase):
        """The state when the run is in this phase."""

        def there():
            state = self.state()
            assert state["phase"] in (phase, "starting", "running", "paused", "ending"), state
            return state["phase"] == phase and state

        return wait_for(there, lambda: self.get("/api/run").text)


class Listener:
    """A page that reads its socket in a thread and keeps what it was told."""

    def __init__(self, client):
        self._stack = ExitStack()
        self.socket = self._stack.enter_context(client.socket())
        self.newest, self.frames = {}, []
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self):
        received = 0
        with suppress(ConnectionClosed):
            for text in self.socket:
                message = json.loads(text)
                received += 1
                self.newest[message["kind"]] = message[message["kind"]]
                if message["kind"] == "frames":
                    self.frames += message["frames"]
                self.socket.send(json.dumps({"ack": received}))

    def until(self, kind, true=lambda _: True):
        """The newest message of a kind, when it is there and `true`."""

        def there():
            newest = self.newest.get(kind)
            return newest not in (None, []) and true(newest) and newest

        return wait_for(there, lambda: self.newest.get(kind))

    def until_events(self, *kinds):
        """Wait until the events have come; a page loses frames, but none of those with events."""

        def there():
            return {*kinds} <= {event["kind"] for frame in [*self.frames] for event in frame.get("events", [])}

        wait_for(there, lambda: self.frames[-1:])

    def until_time(self, seconds):
        """Wait until the newest frame is of this simulated time."""
        wait_for(lambda: self.frames and self.frames[-1]["t"] > seconds, lambda: self.frames[-1:])

    def close(self):
        self._stack.close()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()


@pytest.fixture
def folder(runs, tmp_path, monkeypatch):
    """A working directory with runs of its own; no process that the test has started is left."""
    monkeypatch.chdir(tmp_path)
    before = psutil.Process().children()  # a browser, which serves several tests
    yield tmp_path
    new = [child for child in psutil.Process().children() if child not in before]
    left = [*new, *(child for process in new for child in process.children(recursive=True))]
    for process in left:
        process.kill()
    psutil.wait_procs(left, PATIENCE_S)
    assert not left


@pytest.fixture
def server(folder):
    with Server(0, folder, lambda _: None) as running:
        yield running


@pytest.fixture
def client(server):
    page = Client(server)
    yield page
    page.http.close()


@pytest.fixture
def another(server):
    """A second page of the same user."""
    page = Client(server)
    yield page
    page.http.close()


@pytest.fixture
def listen(client):
    """Connects pages that read the live data."""
    with ExitStack() as stack:

        def listen():
            page = Listener(client)
            stack.callback(page.close)
            return page

        yield listen
