"""Benchmark of `rig web --share`: a paced run at 1 kHz that 30 watchers read as the page does, without drawing it.

With disturbers, another address asks without end, guesses tokens and opens 200 connections, and a laptop is closed.
"""

from __future__ import annotations

import asyncio
import http.client
import json
import socket
import ssl
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any

import psutil

from benchmarks.pages import SCENE, Bench, parted, server, worst
from rig.view.viewer import free_port

WATCHERS = 30
_CONNECTIONS = 200
_MISCHIEF = "127.0.0.3"


def classroom(seconds: float, disturbed: bool = False) -> dict[str, Any]:
    """Return the timing verdict with its reasons, pictures per second and delays [s] (median, 99th percentile) of the
    worst watcher, and the memory of the server for each [MB].
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        pid, (own, of_class) = stack.enter_context(server(folder, f"127.0.0.1:{free_port()}"))
        bench = Bench(*parted(own))
        _say("starts a run")
        bench.ask("/api/run", {"scene": SCENE, "duration": seconds + 12.0})
        while bench.ask("/api/run")["phase"] not in ("running", "ended"):
            time.sleep(0.1)
        time.sleep(2.0)
        alone = psutil.Process(pid).memory_info().rss
        _say(f"{WATCHERS} watchers for {seconds:g} s{', with disturbers' if disturbed else ''}")
        room = _Room(of_class, disturbed)
        stack.callback(room.close)
        time.sleep(5.0)
        begin = time.time()
        start = begin - bench.ask("/api/run/command", {"do": "knock", "impulse": 0.0})["t_ns"] * 1e-9
        time.sleep(seconds)
        end = time.time()
        used = psutil.Process(pid).memory_info().rss - alone
        _say("waits for the end of the run")
        while (state := bench.ask("/api/run"))["phase"] != "ended":
            time.sleep(0.2)
    outcome = state["outcome"] or {"verdict": "INVALID", "reasons": [state["fault"]]}
    told = {"verdict": outcome["verdict"], "reasons": "; ".join(outcome["reasons"])}
    return {**told, **worst(room.pictures, begin, end, start), "memory_MB": used / WATCHERS / 1e6}


def _say(text: str) -> None:
    sys.stderr.write(f"  {text}\n")


class _Room:
    """The watchers, in one thread, and the disturbers, in others."""

    def __init__(self, address: str, disturbed: bool) -> None:
        self.port, self._token = parted(address)
        self.pictures: list[list[tuple[float, float]]] = [[] for _ in range(WATCHERS)]
        self._context = ssl.create_default_context()
        self._context.check_hostname = False
        self._context.verify_mode = ssl.CERT_NONE  # a person compares the fingerprint
        self._stopped = threading.Event()
        work = [self._watch, *([self._hammer, self._guess, self._connect] if disturbed else [])]
        self._disturbed = disturbed
        self._threads = [threading.Thread(target=one, daemon=True) for one in work]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Go home."""
        self._stopped.set()
        for thread in self._threads:
            thread.join(20.0)

    def _watch(self) -> None:
        async def all_of_them() -> None:
            tasks = [asyncio.create_task(self._read(pictures)) for pictures in self.pictures]
            if self._disturbed:
                tasks.append(asyncio.create_task(self._closed_laptop()))
            while not self._stopped.is_set():
                await asyncio.sleep(0.1)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

        asyncio.run(all_of_them())

    def _live(self, local: str = "127.0.0.1") -> Any:
        from websockets.asyncio.client import connect

        base: Any = f"https://127.0.0.1:{self.port}"
        head = {"Cookie": f"class-{self.port}={self._token}.watcher"}
        where = f"wss://127.0.0.1:{self.port}/live"
        return connect(where, additional_headers=head, origin=base, ssl=self._context, local_addr=(local, 0))

    async def _read(self, pictures: list[tuple[float, float]]) -> None:
        async with self._live() as page:
            received = 0
            async for text in page:
                message = json.loads(text)
                received += 1
                if message["kind"] == "frames":
                    pictures += [(time.time(), frame["t"]) for frame in message["frames"][-1:]]
                await page.send(json.dumps({"ack": received}))

    async def _closed_laptop(self) -> None:
        async with self._live(_MISCHIEF) as page:
            await asyncio.sleep(3600.0)
            await page.recv()

    def _ask(self, line: http.client.HTTPSConnection, path: str, head: dict[str, str]) -> None:
        try:
            line.request("GET", path, headers=head)
            line.getresponse().read()
        except (OSError, http.client.HTTPException):
            line.close()
            time.sleep(0.01)

    def _line(self) -> http.client.HTTPSConnection:
        mine = (_MISCHIEF, 0)
        return http.client.HTTPSConnection(
            "127.0.0.1", self.port, timeout=10.0, context=self._context, source_address=mine
        )

    def _hammer(self) -> None:
        with closing(self._line()) as line:
            while not self._stopped.is_set():
                self._ask(line, "/api/run", {"Cookie": f"class-{self.port}={self._token}.hammer"})

    def _guess(self) -> None:
        while not self._stopped.is_set():
            with closing(self._line()) as line:
                self._ask(line, "/?token=guess", {})

    def _connect(self) -> None:
        opened = []
        for _ in range(_CONNECTIONS):
            with suppress(OSError):
                opened.append(socket.create_connection(("127.0.0.1", self.port), 2.0, (_MISCHIEF, 0)))
        self._stopped.wait()
        for one in opened:
            one.close()
