"""The routes of the server: the page, its JSON interface, the web socket with the live data.

    GET  /                        the page;  /page/...: its modules
    GET  /api/scenes              scenes to choose from
    POST /api/scene               {scene, changes, duration} -> the form of the scene with these values
    POST /api/scene/save          {scene, changes, name} -> the file written
    GET  /api/run                 state of the run, and its latest events
    POST /api/run                 {scene, changes, pace, duration} -> starts a run
    POST /api/run/command         {do, run, ...} -> answer of the plant
    POST /api/run/set             {key, value, run} -> values after the change
    POST /api/class               {do: hand, to} or {do: back} -> who operates the run that a class watches
    GET  /api/live                runs of other terminals
    POST /api/run/follow          {run} -> follows one of them;  /api/run/leave: no longer
    GET  /api/recordings          the recordings of the folder;  GET /recordings/NAME: one of them, to keep
    POST /api/recordings/open     {name} -> a whole recording (`rig.web.playback`)
    POST /api/recordings/picture  {name} -> its rig before the run (`rig.web.playback.at_rest`)
    POST /api/recordings/work     {what, name, other, at, changes} -> a job with a recording (`rig.web.recordings`)
    GET  /api/studies             maps, cost tables, branches;  GET /studies/KIND/NAME/FILE: a figure or a table of one
    POST /api/studies/work        {what, scene, changes, x, y} -> a job of a scene (`rig.web.studies`)
    POST /api/studies/beside      {scene, changes} -> the finished branches and maps of this scene
    GET  /api/lessons             the lessons;  GET /lessons/NAME: a figure of one
    POST /api/lesson              {number, language} -> the text of a lesson as HTML
    POST /api/lesson/run          {number, command} -> a job: a command of the lesson
    GET  /api/jobs                jobs, the newest first;  GET /jobs/NUMBER: the result of one
    POST /api/jobs/stop           {number} -> the jobs
    WS   /live                    messages {"kind": "state" | "setup" | "values" | "status" | "frames", ...}
    WS   /sound/SENSOR             samples of a sensor of the run (`rig.web.sound`)

A refusal has the status 422 and the body {"error": text}: the text that the command line would print.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from rig.analysis.report.page import LOOK
from rig.bus.topics import Message
from rig.errors import RigError, UsageError
from rig.machine.files import RUNS
from rig.web import lessons
from rig.web.broadcast import Broadcast
from rig.web.catalogue import Catalogue
from rig.web.form import as_text, form, timing
from rig.web.frames import Frame
from rig.web.jobs import Jobs
from rig.web.lessons import LessonJobs
from rig.web.plain_json import Answer
from rig.web.playback import at_rest, recorded
from rig.web.recordings import Recordings
from rig.web.run_control import RunControl
from rig.web.seat import Seat, of_a_class
from rig.web.sound import Sounds, packed
from rig.web.studies import Studies

PAGE = Path(__file__).parent / "page"
"""Folder of the page."""
BESIDE = ("gallery.js", "loudspeaker.js")
"""Modules that run beside the page, in threads of their own: pictures, sound."""
LARGEST = 1 << 20
"""Largest request body [bytes]."""
_URGENT = 64
"""Most commands to the run that wait for its answer at a time; each waits for a bounded time. # chosen"""
ALONE = {
    "content-security-policy": "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data: 'self'; "
    "frame-ancestors 'self'"
}
"""Rules for a file that is shown: it loads nothing, and no script of it runs."""

Handler = Callable[[dict[str, Any]], Any]
Runs = Callable[[Callable[[dict[str, Any]], Response], dict[str, Any]], Awaitable[Response]]


class Bench:
    """What the routes work on: catalogue, the present run, the connected pages."""

    def __init__(self, folder: Path, say: Callable[[str], object] = lambda _: None) -> None:
        self.catalogue = Catalogue(folder)
        self.broadcast = Broadcast()
        self.seat = Seat(self._seated)
        self._class: Broadcast | None = None
        self.sounds = Sounds()
        self.control = RunControl(
            lambda: self._call(self._put, "state", self.control.state),
            partial(self._call, self._frame),
            partial(self._call, self._put),
            say,
            self._samples,
        )
        self.jobs = Jobs()
        self.recordings = Recordings(folder / RUNS, self.jobs)
        self.studies = Studies(folder, self.catalogue, self.jobs)
        self.lessons = LessonJobs(self.jobs)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._urgent = ThreadPoolExecutor(_URGENT, "urgent")

    async def urgently(self, make: Callable[[dict[str, Any]], Response], body: dict[str, Any]) -> Response:
        """Call a function in a thread for commands to the run: they do not wait for other requests."""
        return await asyncio.get_running_loop().run_in_executor(self._urgent, make, body)

    def attach(self) -> None:
        """Begin to pass what happens on to the pages, in the running event loop."""
        self._loop = asyncio.get_running_loop()
        self._put("state", self.control.state)
        if self._class is not None:
            self._seated()

    def share(self, broadcast: Broadcast) -> None:
        """Tell a class what happens too, but not what belongs to the user alone."""
        self._class = broadcast

    def _put(self, kind: str, content: Any) -> None:
        self.broadcast.put(kind, content)
        if self._class is not None:
            self._class.put(kind, of_a_class(content) if kind == "state" else content)

    def _frame(self, frame: Frame) -> None:
        self.broadcast.frame(frame)
        if self._class is not None:
            self._class.frame(frame)

    def _seated(self) -> None:
        self._call(self._put, "class", self.seat.state)

    def of_class(self, body: dict[str, Any]) -> Any:
        """Hand the operation over to a watcher, or take it back."""
        if body.get("do") == "hand":
            self.seat.hand(body.get("to"))
        else:
            self.seat.back()
        return self.seat.state

    def command(self, body: dict[str, Any]) -> Any:
        """A command to the run, unless a watcher operates it."""
        self.seat.check_user(body.get("do"))
        return self.control.command(body)

    def set(self, body: dict[str, Any]) -> Any:
        """Change a value of the run, unless a watcher operates it."""
        self.seat.check_user("set")
        return self.control.set(body)

    def _call(self, function: Callable[..., object], *arguments: Any) -> None:
        if self._loop is not None:
            with suppress(RuntimeError):  # the loop has ended: so have all pages
                self._loop.call_soon_threadsafe(function, *arguments)

    def _samples(self, arrived: Sequence[Message]) -> None:
        wanted = self.sounds.wanted
        if wanted:
            self._call(self.sounds.offer, packed(arrived, wanted))

    def form(self, body: dict[str, Any]) -> Any:
        """The form of a scene with changed values."""
        scene = self.catalogue.scene(body.get("scene"), body.get("changes"))
        _, length = timing(scene, min(scene.clock.pace_limit or 1.0, 1.0), body.get("duration"))
        return form(scene, length)

    def save(self, body: dict[str, Any]) -> Any:
        """Write a scene file with changed values."""
        path = self.catalogue.save(body.get("name"), str(body.get("scene")), body.get("changes") or {})
        return {"file": str(path)}

    def state(self, _: dict[str, Any]) -> Any:
        """State of the run and its latest events."""
        return {**self.control.state, "events": self.control.events}

    def start(self, body: dict[str, Any]) -> Any:
        """Start a run."""
        changes = body.get("changes") or {}
        scene = self.catalogue.scene(body.get("scene"), changes)
        pace, length = timing(scene, body.get("pace"), body.get("duration"))
        texts = {key: as_text(value, key) for key, value in changes.items()}
        return self.control.start(scene, str(body["scene"]), texts, pace, length)

    def recorded(self, body: dict[str, Any]) -> Any:
        """A whole recording."""
        return recorded(self.recordings.path(body.get("name")))

    def at_rest(self, body: dict[str, Any]) -> Any:
        """The rig of a recording before its run."""
        return at_rest(self.recordings.path(body.get("name")))

    def stop_job(self, body: dict[str, Any]) -> Any:
        """Stop a job."""
        self.jobs.job(body.get("number")).stop()
        return self.jobs.all()

    def close(self) -> None:
        """End the present run in order, and all jobs."""
        self.control.end()
        self.jobs.close()


def app(bench: Bench) -> Starlette:
    """The application, without the guard (`rig.web.server`)."""
    routes = [
        Route("/", _page),
        Route("/page/look.css", look),
        Mount("/page", GZipMiddleware(StaticFiles(directory=PAGE))),
        _get("/api/scenes", lambda _: bench.catalogue.cards()),
        _post("/api/scene", bench.form),
        _post("/api/scene/save", bench.save),
        _get("/api/run", bench.state, _at_once),
        _post("/api/run", bench.start),
        _post("/api/run/command", bench.command, bench.urgently),
        _post("/api/run/set", bench.set),
        _post("/api/class", bench.of_class),
        _get("/api/live", bench.control.others),
        _post("/api/run/follow", bench.control.follow),
        _post("/api/run/leave", bench.control.leave),
        _get("/api/recordings", lambda _: bench.recordings.all()),
        _post("/api/recordings/open", bench.recorded),
        _post("/api/recordings/picture", bench.at_rest),
        _post("/api/recordings/work", bench.recordings.work),
        Route("/recordings/{name:path}", _file(lambda values: bench.recordings.path(values["name"]))),
        _get("/api/studies", lambda _: bench.studies.all()),
        _post("/api/studies/work", bench.studies.work),
        _post("/api/studies/beside", bench.studies.beside),
        Route("/studies/{kind}/{name}/{file}", _file(lambda values: bench.studies.path(**values))),
        _get("/api/lessons", lessons.listed),
        _post("/api/lesson", lessons.text),
        _post("/api/lesson/run", bench.lessons.run),
        Route("/lessons/{name}", _file(lambda values: lessons.figure(values["name"]))),
        _get("/api/jobs", lambda _: bench.jobs.all()),
        _post("/api/jobs/stop", bench.stop_job),
        Route("/jobs/{number:int}", _file(lambda values: bench.jobs.job(values["number"]).file())),
        WebSocketRoute("/live", stream(lambda _: bench.broadcast.connect(), bench.broadcast.disconnect)),
        WebSocketRoute("/sound/{sensor}", stream(bench.sounds.connect, bench.sounds.disconnect)),
    ]
    return Starlette(routes=routes)


async def _page(_: Request) -> Response:
    """The page, which names its modules, so that a browser loads them at once and not one after the other."""
    modules = (path.relative_to(PAGE).as_posix() for path in sorted(PAGE.rglob("*.js")) if path.name not in BESIDE)
    links = "".join(f'  <link rel="modulepreload" href="/page/{module}">\n' for module in modules)
    html = (PAGE / "index.html").read_text(encoding="utf-8")
    return Response(html.replace("</head>", f"{links}</head>"), media_type="text/html")


async def look(_: Request) -> Response:
    """The style that the page shares with reports."""
    return FileResponse(LOOK)


def _get(path: str, handler: Handler, run: Runs = asyncio.to_thread) -> Route:
    return Route(path, _answers(handler, run))


def _post(path: str, handler: Handler, run: Runs = asyncio.to_thread) -> Route:
    return Route(path, _answers(handler, run), methods=["POST"])


def _answers(handler: Handler, run: Runs) -> Callable[[Request], Awaitable[Response]]:
    """A route that calls `handler` with the JSON object of the request by `run`, and answers in JSON."""

    async def answer(request: Request) -> Response:
        return await run(lambda body: Answer(handler(body)), await body_of(request))

    return guarded(answer)


def guarded(answer: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
    """A route whose refusals are answers."""

    async def guarded(request: Request) -> Response:
        try:
            return await answer(request)
        except ClientDisconnect:  # in the middle of its request: nobody gets this answer
            return Response(status_code=400)
        except RigError as fault:
            return Answer({"error": str(fault)}, 422)
        except OSError as fault:  # of the system, as a full disk
            return Answer({"error": str(fault)}, 507)

    return guarded


async def _at_once(make: Callable[[dict[str, Any]], Response], body: dict[str, Any]) -> Response:
    """Call a function that waits for nothing, in the event loop."""
    return make(body)


def _file(find: Callable[[dict[str, Any]], Path]) -> Callable[[Request], Awaitable[Response]]:
    """A route to the file that `find` returns for the values in the path.

    A page or a picture is shown, without any right on this page; other files are kept.
    """

    async def answer(request: Request) -> Response:
        path = await asyncio.to_thread(find, request.path_params)
        shown = path.suffix in (".html", ".png")
        how = "inline" if shown else "attachment"
        rules = ALONE if shown else None
        return FileResponse(path, filename=path.name, content_disposition_type=how, headers=rules)

    return guarded(answer)


async def body_of(request: Request, largest: int = LARGEST) -> dict[str, Any]:
    """The JSON object of a request, {} of one without a body. Raises UsageError; `largest`: in bytes."""
    if request.method != "POST":
        return {}
    text = b""
    async for part in request.stream():
        text += part
        if len(text) > largest:
            raise UsageError(f"the request is longer than the {largest} bytes that are allowed")
    try:
        body = json.loads(text)
        json.dumps(body, ensure_ascii=False).encode()  # half a character, which no answer could repeat
    except (ValueError, RecursionError) as fault:
        raise UsageError(f"the request is not JSON text: {fault!s:.100}") from None
    if not isinstance(body, dict):
        raise UsageError(f"the request is {body!r:.80}; expected a JSON object")
    return body


def stream(
    connect: Callable[[WebSocket], Any], disconnect: Callable[[Any], object]
) -> Callable[[WebSocket], Awaitable[None]]:
    """A web socket that sends what `next()` of a page returns, and passes what it receives to its `heard`.

    `connect` makes the page (`rig.web.broadcast.Page`, `rig.web.sound.Listener`).
    """

    async def stream(socket: WebSocket) -> None:
        await socket.accept()
        page = connect(socket)

        async def pump() -> None:
            while True:
                for message in await page.next():
                    if isinstance(message, str):
                        await socket.send_text(message)
                    else:
                        await socket.send_bytes(message)

        sending = asyncio.create_task(pump())
        try:
            while True:
                page.heard(await socket.receive_text())
        except (WebSocketDisconnect, KeyError):  # KeyError: a binary message, which no page of ours sends
            pass
        finally:
            disconnect(page)
            sending.cancel()
            with suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await sending

    return stream
