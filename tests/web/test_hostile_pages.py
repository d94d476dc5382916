"""Requests and messages that no page of ours sends: a refusal in words, never a failure of the server."""

import contextlib
import json
import socket
import threading
import time

import httpx
import pytest
from websockets.exceptions import ConnectionClosed

ROUTES = {
    "/api/scene": {"scene": "belt", "changes": {}, "duration": 1.0},
    "/api/scene/save": {"scene": "belt", "changes": {"load.force": -1}, "name": "../mine"},
    "/api/run": {"scene": "nothing", "changes": {}, "pace": 1.0, "duration": 1.0},
    "/api/run/command": {"do": "knock", "run": "", "impulse": 1.0, "controller": "nf"},
    "/api/run/set": {"key": "load.force", "value": 1.0, "run": ""},
    "/api/recordings/work": {"what": "verify", "name": "nothing", "other": "nothing"},
    "/api/run/follow": {"run": "nothing"},
    "/api/run/leave": {"run": "nothing"},
    "/api/studies/work": {"what": "map", "scene": "nothing", "changes": {}, "x": "", "y": ""},
    "/api/lesson": {"number": 99},
    "/api/jobs/stop": {"number": 1},
    "/api/view": {"run": ""},
}
VALUES = (
    None, True, -1, 1e308, float("nan"), float("inf"), 10**400, "9" * 5000, "", "../x", "/etc/passwd", "\0", "a\0b",
    "\ud800", "é", "1 N", [], {}, {"load.force": float("nan")}, {"load.force": None}, {"": 1}, {"\ud800": 1},
    {"x" * 10000: 1}, {"load": {"force": 1}},
)  # fmt: skip
PATHS = ("/page/../server.py", "/page/..%2fserver.py", "/page/%2e%2e/server.py", "/page//etc/passwd", "/page/%00",
         "/recordings/..%2f..%2fetc%2fpasswd", "/recordings/%2e%2e", "/recordings/%00", "/jobs/-1", "/jobs/9999999999",
         "/recordings/" + "a" * 5000)  # fmt: skip


@pytest.mark.parametrize("path", ROUTES)
def test_senseless_values_are_answered_in_words(client, folder, path):
    for key in ROUTES[path]:
        for value in VALUES:
            found = client.http.post(path, content=json.dumps({**ROUTES[path], key: value}).encode())
            assert found.status_code == 422 or (path == "/api/scene" and found.status_code == 200), (key, value)
            assert found.status_code == 200 or found.json()["error"]
    assert client.state()["phase"] == "idle"
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("path", PATHS)
def test_a_path_does_not_leave_its_folder(client, path):
    with socket.create_connection(("127.0.0.1", client.server.port), 5.0) as raw:  # a client would tidy the path
        raw.sendall(
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{client.server.port}\r\nCookie: {client.cookie}\r\n"
            "Connection: close\r\n\r\n".encode()
        )
        answer = b"".join(iter(lambda: raw.recv(4096), b""))
    assert answer.split()[1] in (b"404", b"422"), answer[:200]


@pytest.mark.parametrize("message", ["[" * 3000, "x" * 10**6, b"\xff" * 100, '{"ack": 1e999}', '{"ack": -5}'])
def test_a_senseless_message_ends_at_most_its_own_connection(client, listen, message, capfd):
    page = listen()
    with contextlib.suppress(ConnectionClosed, TimeoutError), client.socket() as hostile:
        hostile.send(message)
        hostile.recv(0.5)
        hostile.recv(0.5)
    page.until("state")
    assert client.state()["phase"] == "idle"
    assert "Traceback" not in capfd.readouterr().err


def test_state_and_emergency_stop_wait_for_no_other_request(client, monkeypatch):
    released, waiting = threading.Event(), []

    def hangs(*_):
        waiting.append(1)
        released.wait(60.0)
        return []

    for name in ("cards", "scene"):
        monkeypatch.setattr(client.server.bench.catalogue, name, hangs)
    others = [threading.Thread(target=client.get, args=("/api/scenes",)) for _ in range(40)]
    try:
        for one in others:
            one.start()
        while not waiting:
            time.sleep(0.01)
        with httpx.Client(base_url=client.base, cookies=client.http.cookies, timeout=10.0) as page:
            assert page.get("/api/run").json()["phase"] == "idle"
            stopped = page.post("/api/run/command", json={"do": "emergency"})
            assert stopped.json() == {"error": "no run is active; start one first"}
    finally:
        released.set()
        for one in others:
            one.join()


def test_many_connections_leave_the_server_at_work(client, listen):
    page = listen()
    others = []
    try:
        for _ in range(400):
            others.append(socket.create_connection(("127.0.0.1", client.server.port), 5.0))
        for one in others[::2]:
            one.sendall(b"GET /live HTTP/1.1\r\nHost: ")  # never ended
        begin = time.monotonic()
        assert client.state()["phase"] == "idle"
        assert time.monotonic() - begin < 5.0
    finally:
        for one in others:
            one.close()
    page.until("state")
