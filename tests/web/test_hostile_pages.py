"""Requests and messages that no page of ours sends: a refusal in words, never a failure of the server."""

import json
import socket
import threading

from patience import PATIENCE_S

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
    "/api/recordings/open": {"name": "x"},
    "/api/lesson/run": {"number": 1, "command": "rig modes belt"},
}
VALUES = (None, float("nan"), 10**400, "../x", "a\0b", "\ud800", [], {"load": {"x": 1}})
PATHS = (
    "/page/../server.py",
    "/page/..%2fserver.py",
    "/page/%00",
    "/recordings/..%2f..%2fetc%2fpasswd",
    "/jobs/-1",
    "/recordings/" + "a" * 5000,
)


def test_senseless_values_are_answered_in_words(client, folder):
    for path, body in ROUTES.items():
        for key in body:
            for value in VALUES:
                answer = client.http.post(path, content=json.dumps({**body, key: value}).encode())
                assert answer.status_code == 422 or (path == "/api/scene" and answer.status_code == 200), (path, value)
                assert answer.status_code == 200 or answer.json()["error"]
    assert client.state()["phase"] == "idle"
    assert list(folder.iterdir()) == []


def test_a_path_does_not_leave_its_folder(client):
    for path in PATHS:
        with socket.create_connection(("127.0.0.1", client.server.port)) as raw:  # a client would tidy the path
            raw.sendall(
                f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{client.server.port}\r\nCookie: {client.cookie}\r\n"
                "Connection: close\r\n\r\n".encode()
            )
            answer = b"".join(iter(lambda raw=raw: raw.recv(4096), b""))
        assert answer.split()[1] in (b"404", b"422"), answer[:200]


def test_state_and_emergency_stop_wait_for_no_other_request(client, another, monkeypatch):
    released, waiting = threading.Event(), threading.Event()

    def hangs(*_):
        waiting.set()
        released.wait(PATIENCE_S)
        return []

    monkeypatch.setattr(client.server.bench.catalogue, "cards", hangs)
    others = [threading.Thread(target=client.get, args=("/api/scenes",)) for _ in range(40)]
    try:
        for other in others:
            other.start()
        assert waiting.wait(PATIENCE_S)
        assert another.state()["phase"] == "idle"
        assert another.command("emergency") == {"error": "no run is active; start one first"}
        assert all(other.is_alive() for other in others)
    finally:
        released.set()
        for other in others:
            other.join()
