"""A class: what a watcher sees, what it may not do, who operates, and the bounds of all that it can ask for."""

import asyncio
import hashlib
import json
import socket
import ssl
import threading
from contextlib import contextmanager

import httpx
import pytest
from patience import PATIENCE_S, wait_for
from ports import own_port
from websockets.asyncio.client import connect as connecting
from websockets.exceptions import ConnectionClosed, InvalidStatus

from rig.errors import UsageError
from rig.web import share
from rig.web.app import app
from rig.web.frames import Frame
from rig.web.seat import Seat, public
from rig.web.server import Server

pytest.importorskip("cryptography")


def free_place():
    return f"127.0.0.1:{own_port()}"


@pytest.fixture
def server(folder):
    with Server(0, folder, lambda _: None, free_place()) as running:
        yield running


class Watcher:
    """What the page of a watcher does, without a browser."""

    def __init__(self, share):
        self.base, _, _ = share.address.partition("/?")
        self.context = ssl.create_default_context()
        self.context.check_hostname = False
        self.context.verify_mode = ssl.CERT_NONE
        self.http = httpx.Client(base_url=self.base, verify=self.context, follow_redirects=True, timeout=PATIENCE_S)
        self.first = self.http.get(share.address)
        self.you = self.http.get("/api/class").json()["you"]

    def post(self, path, **body):
        return self.http.post(path, json=body)

    @contextmanager
    def socket(self):
        cookie = "; ".join(f"{name}={value}" for name, value in self.http.cookies.items())
        address = self.base.replace("https", "wss") + "/live"
        opened = OneThread(address, additional_headers={"Cookie": cookie}, origin=self.base, ssl=self.context)
        try:
            yield opened
        finally:
            opened.close()


class OneThread:
    """A web socket whose TLS runs in one thread.

    Those of websockets.sync read in one thread and write in another, which OpenSSL does not allow: on a busy machine
    one of 3000 handshakes never ends.
    """

    def __init__(self, address, **options):
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._thread.start()
        try:
            self._opened = self._result(self._open(address, options))
        except BaseException:
            self._end()
            raise

    async def _open(self, address, options):
        return await connecting(address, **options)

    def send(self, text):
        self._result(self._opened.send(text))

    def recv(self):
        return self._result(self._opened.recv())

    def close(self):
        self._result(self._opened.close())
        self._end()

    def _result(self, step):
        return asyncio.run_coroutine_threadsafe(step, self._loop).result(PATIENCE_S)

    def _end(self):
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


@pytest.fixture
def watcher(server):
    made = Watcher(server.share)
    yield made
    made.http.close()


@pytest.fixture
def other(server):
    made = Watcher(server.share)
    yield made
    made.http.close()


def test_the_address_opens_the_page_for_watching_and_the_certificate_has_the_printed_fingerprint(server, watcher):
    assert watcher.first.status_code == 200
    assert "/page/watch.js" in watcher.first.text
    assert "/page/main.js" not in watcher.first.text
    (cookie,) = watcher.http.cookies.jar
    assert cookie.secure
    host, port = server.share.address.removeprefix("https://").partition("/")[0].split(":")
    shown = ssl.PEM_cert_to_DER_cert(ssl.get_server_certificate((host, int(port))))
    assert hashlib.sha256(shown).hexdigest().upper() == server.share.fingerprint.replace(":", "")


@pytest.mark.parametrize("path", ["/", "/api/run", "/?token=wrong"])
def test_without_the_token_the_remedy_is_told_late(server, path):
    answer = httpx.get(server.share.address.partition("/?")[0] + path, verify=False)
    assert answer.status_code == 403
    assert "ask who runs it" in answer.text
    assert answer.elapsed.total_seconds() >= share.WRONG_S


def test_the_token_of_the_class_does_not_open_the_page_of_the_user(server, client):
    own = f"http://127.0.0.1:{server.port}"
    assert httpx.get(f"{own}/?token={server.share.token}").status_code == 403
    assert (
        httpx.get(f"{server.share.address.partition('/?')[0]}/?token={server.token}", verify=False).status_code == 403
    )


def test_a_watcher_has_no_route_of_the_user(server, watcher):
    """Each route of the page of the user is absent or refused, by each method."""
    allowed = {("GET", "/"), ("GET", "/api/run"), ("GET", "/page/look.css"), ("GET", "/api/class")}
    routes = [route for route in app(server.bench).routes if hasattr(route, "methods")]
    assert len(routes) > 25
    for route in routes:
        path = route.path.replace("{number:int}", "1").replace("{name:path}", "x").replace("{name}", "x")
        path = path.replace("{kind}", "x").replace("{file}", "x")
        for method in ("GET", "POST"):
            if (method, path) not in allowed:
                answer = watcher.http.request(method, path, json={})
                assert answer.status_code in (404, 405, 422), (method, path)
                if answer.status_code == 422 and path != "/api/class":
                    assert "only who operates can do this" in answer.text
    with pytest.raises(InvalidStatus):
        OneThread(watcher.base.replace("https", "wss") + "/sound/x", ssl=watcher.context, origin=watcher.base)


def test_the_state_for_a_class_has_no_command_line_and_no_file(watcher, client):
    told = watcher.http.get("/api/run").json()
    assert told["phase"] == "idle"
    assert told["lines"] == []
    assert {"command", "log"}.isdisjoint(told)


def test_the_operation_is_asked_for_handed_over_and_given_back(client, watcher, other):
    watcher.post("/api/class", do="ask", name=" Ada ")
    assert "choose one who does" in client.refused("/api/class", do="hand", to=other.you)
    handed = client.post("/api/class", do="hand", to=watcher.you).json()
    assert handed == {"holder": watcher.you, "name": "Ada", "asking": []}
    assert watcher.post("/api/run/command", do="pause").json()["error"] == "no run is active; start one first"
    assert "only who operates" in other.post("/api/run/command", do="pause").json()["error"]
    assert "only the private page" in watcher.post("/api/run/command", do="stop").json()["error"]
    assert "only who operates" in other.post("/api/run/set", key="a", value=1).json()["error"]
    assert "Ada operates the run" in client.refused("/api/run/command", do="pause")
    assert "Ada operates the run" in client.refused("/api/run/set", key="a", value=1)
    assert "no run is active" in client.refused("/api/run/command", do="emergency")
    other.post("/api/class", do="back")
    assert watcher.post("/api/run/command", do="pause").json()["error"] == "no run is active; start one first"
    watcher.post("/api/class", do="back")
    assert "no run is active" in client.refused("/api/run/command", do="pause")
    assert "only who operates" in watcher.post("/api/run/command", do="pause").json()["error"]


def test_who_operates_loses_the_operation_without_a_page(client, watcher, monkeypatch):
    monkeypatch.setattr(share, "ABSENT_S", 0.1)
    watcher.post("/api/class", do="ask", name="Ada")
    with watcher.socket() as page:
        assert json.loads(page.recv())["kind"] in ("state", "class")
        client.post("/api/class", do="hand", to=watcher.you)
    wait_for(lambda: client.post("/api/run/command", do="pause").json()["error"].startswith("no run"))


@pytest.mark.parametrize("name", [None, "", " \n", "x" * 41, "a\0b", 3])
def test_a_name_that_cannot_be_shown_is_refused(name):
    with pytest.raises(UsageError, match="printable characters"):
        Seat().ask("w", name)


def test_no_more_than_a_class_can_ask():
    seat = Seat()
    for number in range(40):
        seat.ask(str(number), f"n{number}")
    with pytest.raises(UsageError, match="40 watchers ask already"):
        seat.ask("40", "late")
    seat.back("3")
    seat.ask("40", "late")
    assert seat.state["asking"][-1] == {"id": public("40"), "name": "late"}


def test_a_watcher_that_hammers_the_socket_is_dropped(watcher):
    def hammer():
        with watcher.socket() as page:
            for _ in range(100_000):
                page.send("{}")

    with pytest.raises(ConnectionClosed):
        hammer()


def test_a_long_request_is_refused(watcher):
    answer = watcher.post("/api/class", do="ask", name="x" * (share.LARGEST + 1))
    assert "longer than the 4096 bytes" in answer.json()["error"]


def test_a_page_that_does_not_answer_is_dropped(folder, monkeypatch):
    """A laptop that is closed: its web socket is open, and nothing comes back."""
    monkeypatch.setattr(share, "PINGED_S", 0.2)
    with Server(0, folder, lambda _: None, free_place()) as server:
        watcher = Watcher(server.share)
        host, port = watcher.base.removeprefix("https://").split(":")
        cookie = "; ".join(f"{name}={value}" for name, value in watcher.http.cookies.items())
        lines = ["GET /live HTTP/1.1", f"Host: {host}:{port}", f"Origin: {watcher.base}", f"Cookie: {cookie}"]
        lines += ["Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13"]
        lines += ["Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "", ""]
        with watcher.context.wrap_socket(socket.create_connection((host, int(port)), PATIENCE_S)) as closed:
            closed.sendall("\r\n".join(lines).encode())
            assert closed.recv(12) == b"HTTP/1.1 101"
            while closed.recv(1 << 16):  # until the server ends it
                pass
        watcher.http.close()


def test_connections_beyond_the_bound_are_closed_at_once(server, watcher):
    host, port = watcher.base.removeprefix("https://").split(":")
    made = [socket.create_connection((host, int(port))) for _ in range(share.OF_ONE + 20)]

    def closed(one):
        one.settimeout(0.01)
        try:
            return one.recv(1) == b""
        except TimeoutError:
            return False
        except ConnectionResetError:
            return True

    try:
        wait_for(lambda: all(closed(one) for one in made[share.OF_ONE :]))
        assert not closed(made[0])
        assert watcher.http.get("/api/class").status_code == 200  # by its open connection
    finally:
        for one in made:
            one.close()


def _held(address, count):
    """Bare connections that ask for nothing."""
    return [socket.create_connection(address, PATIENCE_S) for _ in range(count)]


def test_thirty_laptops_behind_one_address_get_in_beside_two_hundred_connections(server, watcher):
    """Each laptop with six connections for the page and one web socket, all from the address of the disturber."""
    host, port = watcher.base.removeprefix("https://").split(":")
    disturbing = _held((host, int(port)), 200)
    pages = sorted(path.name for path in share.PAGE.glob("*.js"))[:6]

    async def laptop():
        six = {"limits": httpx.Limits(max_connections=6), "timeout": PATIENCE_S}
        async with httpx.AsyncClient(base_url=watcher.base, verify=watcher.context, **six) as http:
            await http.get("/", params={"token": server.share.token})
            loaded = await asyncio.gather(*(http.get(f"/page/{name}") for name in pages))
            head = {"Cookie": "; ".join(f"{name}={value}" for name, value in http.cookies.items())}
            live = watcher.base.replace("https", "wss") + "/live"
            async with connecting(live, additional_headers=head, origin=watcher.base, ssl=watcher.context) as page:
                await page.recv()
                return {answer.status_code for answer in loaded}

    async def all_of_them():
        return await asyncio.gather(*(laptop() for _ in range(30)))

    try:
        assert asyncio.run(all_of_them()) == [{200}] * 30
    finally:
        for one in disturbing:
            one.close()


@pytest.mark.parametrize("begun", [b"", b"GET / HTTP/1.1\r\nHost: "], ids=["no handshake", "half a request"])
def test_who_asks_for_nothing_loses_its_place_to_the_next(server, monkeypatch, begun):
    monkeypatch.setattr(share, "OF_ONE", 5)
    monkeypatch.setattr(share, "ASKING_S", 0.5)
    host, port = server.share.address.removeprefix("https://").partition("/")[0].split(":")
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    idle = _held((host, int(port)), 5)
    if begun:
        idle = [context.wrap_socket(one) for one in idle]
        for one in idle:
            one.sendall(begun)
    try:
        wait_for(lambda: _answers(server.share.address))
    finally:
        for one in idle:
            one.close()


def _answers(address):
    try:
        return httpx.get(address, verify=False).status_code == 303
    except httpx.HTTPError:
        return False


def test_a_watcher_that_asks_without_end_is_slowed_and_the_others_are_not(watcher, other):
    codes = {watcher.http.get("/api/class").status_code for _ in range(220)}
    assert codes == {200, 429}
    assert other.http.get("/api/class").status_code == 200


def test_a_class_may_watch_by_ipv6(folder):
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("this machine has no IPv6")
    with Server(0, folder, lambda _: None, f"[::1]:{own_port()}") as server:
        watcher = Watcher(server.share)
        assert watcher.first.status_code == 200
        with watcher.socket() as page:
            assert json.loads(page.recv())["kind"] in ("state", "class")
        watcher.http.close()


def test_a_name_in_capital_letters_opens_the_page_as_browsers_write_it(folder):
    with Server(0, folder, lambda _: None, f"LocalHost:{own_port()}") as server:
        assert server.share.address.startswith("https://localhost:")
        made = Watcher(server.share)
        assert made.first.status_code == 200
        made.http.close()


def test_a_rate_bounds_the_burst_and_what_follows():
    rate = share.Rate(burst=5, per_s=1e-3)
    assert [rate.late_s("a") == 0.0 for _ in range(7)] == [True] * 5 + [False] * 2
    assert rate.late_s("b") == 0.0


def test_a_message_is_made_once_for_all_watchers():
    async def texts():
        broadcast = share.Broadcast(share.HISTORY, 0.01)
        pages = [broadcast.connect() for _ in range(3)]
        for n in (1, 2, 3):
            broadcast.frame(Frame(json.dumps({"n": n}), False))
        return [await page.next() for page in pages]

    first, *others = asyncio.run(texts())
    assert all(other[0] is first[0] for other in others)


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("127.0.0.1", "expected HOST:PORT"),
        ("127.0.0.1:80", "the port must be 1024 to 65535"),
        ("127.0.0.1:99999", "the port must be 1024 to 65535"),
        ("0.0.0.0:8443", "name the one address"),
        ("192.0.2.7:8443", "give an address of this host"),
        ("no-such-name.invalid:8443", "no address is known for the name"),
    ],
)
def test_a_place_where_it_cannot_listen_is_refused(folder, place, why):
    with pytest.raises(UsageError, match=why) as refused:
        Server(0, folder, share=place)
    assert "\n" not in str(refused.value)


def test_a_place_in_use_is_refused(server, folder):
    with pytest.raises(UsageError, match="another process listens there"):
        Server(0, folder, share=server.share.address.removeprefix("https://").partition("/")[0])


def test_pictures_of_a_class_keep_their_time_whatever_a_watcher_sends():
    async def texts():
        broadcast = share.Broadcast(share.HISTORY, 0.05)
        page = broadcast.connect()
        counts = []
        for n in range(1, 5):
            broadcast.frame(Frame(json.dumps({"n": n}), False))
            page.heard(json.dumps({"ack": 99}))
            try:
                counts.append(len(await asyncio.wait_for(page.next(), 0.001)))
            except TimeoutError:
                counts.append(0)
        (text,) = await page.next()
        return counts, [frame["n"] for frame in json.loads(text)["frames"]]

    assert asyncio.run(texts()) == ([0, 0, 0, 0], [1, 2, 3, 4])
