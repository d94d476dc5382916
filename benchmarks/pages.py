"""Benchmark of `rig web`: a paced run at 1 kHz with ten pages without a browser, and one with a page in Chromium.

A picture of the browser is a change of the time on its page. The delay of a picture is at most the time from the
tick of its newest data to the end of the script that drew it: the clock of the plant is read by a command, and the
time at which the command was sent counts as that of its tick.
"""

from __future__ import annotations

import http.client
import json
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

PAGES = 10
SCENE = "belt_normal_force"
_CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
_READY = "document.getElementById('scene')?.options.length > 3"
_CHOOSE = """
const { scene, duration } = %s, one = (name) => document.getElementById(name);
const there = (true_) => new Promise((done) => {
  const look = () => true_() ? done(true) : setTimeout(look, 20);
  look();
});
location.hash = `bench/${scene}`;
there(() => one("scene").value === scene && one("values").ariaBusy === "false").then(() => {
  one("duration").value = duration;
  one("duration").dispatchEvent(new Event("change"));
  return there(() => one("values").ariaBusy === "false" && !one("start").disabled);
});
"""
_START = """
new Promise((done) => {
  const begin = performance.now(), time = document.getElementById("time");
  const seen = new MutationObserver(() => {
    if (parseFloat(time.textContent.slice(4)) > 0) { seen.disconnect(); done(performance.now() - begin); }
  });
  seen.observe(time, { childList: true, characterData: true, subtree: true });
  document.getElementById("start").click();
});
"""
_WATCH = """
window.pictures = [];
window.time = document.getElementById("time");
new MutationObserver(() => window.pictures.push([Date.now() / 1e3, parseFloat(window.time.textContent.slice(4))]))
  .observe(window.time, { childList: true, characterData: true, subtree: true });
"""


def pages(seconds: float = 20.0) -> dict[str, Any]:
    """Return the figures of a run that pages without a browser watch, and of one that a page in Chromium watches:
    the timing verdict with its reasons, pictures per second and their delays [s] (median, 99th percentile), worst over
    the pages; in Chromium the seconds from a click on Start to the first picture of the moving rig, and the share of a
    core that layout and style take. There is no browser without Chromium.
    """
    subprocess.run([sys.executable, "-m", "rig", "tool", "warmup", SCENE], check=True, stdout=subprocess.DEVNULL)
    program = next(filter(None, map(shutil.which, _CHROMIUM)), None)
    return {"sockets": _watched(seconds, None), **({"browser": _watched(seconds, program)} if program else {})}


def _watched(seconds: float, program: str | None) -> dict[str, Any]:
    """The figures of a run that `program` watches; None: that pages without a browser watch."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        _, (address,) = stack.enter_context(server(folder))
        port, token = parted(address)
        bench, more = Bench(port, token), {}
        body = {"scene": SCENE, "duration": seconds + 5.0}
        if program:
            browser = stack.enter_context(_Browser(program, folder, port, token))
            browser.evaluate(_CHOOSE % json.dumps(body), wait=True)
            more["moving_s"] = browser.evaluate(_START, wait=True) / 1e3
        else:
            sockets = [stack.enter_context(_Socket(port, bench.cookie)) for _ in range(PAGES)]
            bench.ask("/api/run", body)
        while bench.ask("/api/run")["phase"] not in ("running", "ended"):
            time.sleep(0.1)
        time.sleep(2.0)
        if program:
            browser.evaluate(_WATCH)
            spent = browser.spent()
        begin = time.time()
        start = begin - bench.ask("/api/run/command", {"do": "knock", "impulse": 0.0})["t_ns"] * 1e-9
        time.sleep(seconds)
        end = time.time()
        if program:
            more["layout_share"] = (browser.spent() - spent) / (end - begin)
        seen = [browser.evaluate("window.pictures")] if program else [socket.pictures for socket in sockets]
        while (state := bench.ask("/api/run"))["phase"] != "ended":
            time.sleep(0.2)
    outcome = state["outcome"] or {"verdict": "INVALID", "reasons": [state["fault"]]}
    told = {"verdict": outcome["verdict"], "reasons": "; ".join(outcome["reasons"])}
    return {**told, **worst(seen, begin, end, start), **more}


def worst(pages: list[list[tuple[float, float]]], begin: float, end: float, start: float) -> dict[str, Any]:
    """Pictures per second, and delays [s], of the worst page; pictures are (wall time, simulated time), and simulated 0
    was at `start`.
    """
    counts, delays = [], []
    for pictures in pages:
        ours = [wall - t - start for wall, t in pictures if begin <= wall <= end] or [np.inf]
        counts.append(len(ours))
        delays.append(np.percentile(ours, (50, 99)))
    p50, p99 = np.max(delays, axis=0).tolist()
    return {"pictures_per_s": min(counts) / (end - begin), "delay_s": {"p50": p50, "p99": p99}}


@contextmanager
def server(folder: Path, share: str = "") -> Iterator[tuple[int, list[str]]]:
    """A `rig web` that works in `folder`: its process, its address and, with `share`, that of the class."""
    command = [sys.executable, "-m", "rig", "web", "--no-open", *(["--share", share] if share else [])]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    rest = threading.Thread(target=process.stdout.read, daemon=True)
    try:
        addresses: list[str] = []
        while len(addresses) < (2 if share else 1) and (line := process.stdout.readline()):
            addresses += [word for word in line.split() if "token=" in word]
        rest.start()
        yield process.pid, addresses
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(60.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(10.0)
        if rest.ident is not None:
            rest.join(10.0)
        process.stdout.close()


def parted(address: str) -> tuple[int, str]:
    """Port and token of an address."""
    place, _, token = address.partition("/?token=")
    return int(place.rpartition(":")[2]), token


class Bench:
    """What a program asks of the server."""

    def __init__(self, port: int, token: str) -> None:
        self._port = port
        self.cookie = f"bench-{port}={token}"

    def ask(self, path: str, body: dict[str, Any] | None = None) -> Any:
        """The answer to a request: POST with a body, GET without one."""
        line = http.client.HTTPConnection("127.0.0.1", self._port, timeout=30.0)
        try:
            text = None if body is None else json.dumps(body)
            line.request("GET" if body is None else "POST", path, text, {"Cookie": self.cookie})
            return json.loads(line.getresponse().read())
        finally:
            line.close()


class _Socket:
    """A page without a browser: it reads and acknowledges every message."""

    def __init__(self, port: int, cookie: str) -> None:
        from websockets.sync.client import connect

        self.pictures: list[tuple[float, float]] = []
        origin: Any = f"http://127.0.0.1:{port}"
        self._socket = connect(f"ws://127.0.0.1:{port}/live", additional_headers={"Cookie": cookie}, origin=origin)
        self._thread = threading.Thread(target=self._read, daemon=True)

    def __enter__(self) -> _Socket:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._thread.join(5.0)

    def _read(self) -> None:
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            for received, text in enumerate(self._socket, 1):
                message = json.loads(text)
                if message["kind"] == "frames":
                    self.pictures += [(time.time(), frame["t"]) for frame in message["frames"][-1:]]
                self._socket.send(json.dumps({"ack": received}))


class _Browser:
    """Chromium without a window that shows the page; scripts are evaluated in it."""

    def __init__(self, program: str, folder: Path, port: int, token: str) -> None:
        from websockets.sync.client import connect

        command = [
            program,
            "--headless=new",
            "--no-sandbox",
            "--remote-debugging-port=0",
            "--window-size=1400,1000",
            f"--user-data-dir={folder / 'browser'}",
            f"http://127.0.0.1:{port}/?token={token}",
        ]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        told = folder / "browser" / "DevToolsActivePort"
        for _ in range(300):
            if told.exists() and len(told.read_text().split()) == 2:
                break
            time.sleep(0.1)
        line = http.client.HTTPConnection("127.0.0.1", int(told.read_text().split()[0]), timeout=30.0)
        line.request("GET", "/json/list")
        shown = next(target for target in json.loads(line.getresponse().read()) if target["type"] == "page")
        line.close()
        self._socket = connect(shown["webSocketDebuggerUrl"], max_size=None)
        while self._ask("Runtime.evaluate", {"expression": _READY}).get("result", {}).get("value") is not True:
            time.sleep(0.1)  # the address with the token leads to the page

    def __enter__(self) -> _Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._process.terminate()
        self._process.wait(20.0)

    def evaluate(self, script: str, wait: bool = False) -> Any:
        """The value of a script, or with `wait` of its promise."""
        asked = {"expression": script, "returnByValue": True, "awaitPromise": wait}
        return self._ask("Runtime.evaluate", asked)["result"].get("value")

    def spent(self) -> float:
        """Time that layout and style have taken so far [s]."""
        self._ask("Performance.enable", {})
        known = {one["name"]: one["value"] for one in self._ask("Performance.getMetrics", {})["metrics"]}
        return float(known["LayoutDuration"] + known["RecalcStyleDuration"])

    def _ask(self, method: str, parameters: dict[str, Any]) -> Any:
        self._socket.send(json.dumps({"id": 1, "method": method, "params": parameters}))
        while "id" not in (answer := json.loads(self._socket.recv(60.0))):
            pass
        return answer.get("result", {})
