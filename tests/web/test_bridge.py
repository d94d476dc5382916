"""The bus over WebSocket: the same checks, a controller in JavaScript, clients that die, hang or send nonsense."""

import json
import shutil
import socket
import subprocess
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from waiting_run import RUN, in_process, waiting_run
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from rig.errors import UsageError
from rig.web import bridge, bridge_client
from rig.web.bridge import Bridge

ROOT = Path(__file__).parents[2]
NODE = shutil.which("node")
ADMIT = {"do": "admit", "controller": "it", "reads": ["vibrometer"], "drives": ["load.force"], "period_ns": 1_000_000}


class Client:
    """What a program does with the bridge."""

    def __init__(self, socket):
        self.socket = socket

    def send(self, **message):
        self.socket.send(json.dumps(message))

    def get(self):
        return json.loads(self.socket.recv(5.0))

    def ask(self, **message):
        self.send(**message)
        return self.get()


@contextmanager
def bridged(expected="nobody", seconds=0.3, pace=None):
    with waiting_run(expected, seconds, pace) as run, Bridge(RUN) as made:
        yield run, made


@contextmanager
def client_of(made):
    with connect(made.address, compression=None) as socket:
        yield Client(socket)


def no_client(made, most=0, seconds=10.0):
    """Wait until the bridge has no client any more, or `most`."""
    deadline = time.monotonic() + seconds
    while len(made.clients) > most:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def _websocket():
    """How node is started so that it has WebSocket; None if it has none."""
    for flags in ([], ["--experimental-websocket"]):
        if NODE:
            asked = subprocess.run([NODE, *flags, "-p", "typeof WebSocket"], capture_output=True, text=True, timeout=20)
            if asked.stdout.strip() == "function":
                return [NODE, *flags]
    return None


def test_the_example_in_javascript_has_the_bits_of_a_run_in_one_process(runs):
    node = _websocket()
    if node is None:
        pytest.skip("node (20 or newer) is not installed")
    with bridged("script") as (run, made):
        example = [*node, str(ROOT / "docs" / "wire_controller.mjs"), made.address]
        with subprocess.Popen(example, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            said, wrong = process.communicate(timeout=60.0)
        run.end()
    assert said == f"{RUN} has ended after 300 steps\n", wrong
    here = in_process("script")
    assert run.summary["loop"]["script"] == here.summary["exchange"]["script"]
    assert run.summary["energy"] == here.energy
    assert run.summary["refused"] == {}


def test_only_who_has_the_token_and_comes_from_here_is_let_in(runs):
    with bridged() as (_, made):
        own = f"http://127.0.0.1:{made.port}"
        for address, head in (
            (f"ws://127.0.0.1:{made.port}/", {}),
            (f"ws://127.0.0.1:{made.port}/?token=", {}),
            (made.address[:-1], {}),
            (made.address, {"origin": "http://evil.example"}),
            (made.address, {"origin": "null"}),
            (made.address, {"origin": f"http://127.0.0.1:{made.port + 1}"}),
            (made.address, {"additional_headers": {"Host": "evil.example"}}),
        ):
            with pytest.raises(InvalidStatus) as refused, connect(address, **head):
                pass
            assert refused.value.response.status_code == 403
            assert b"Open the address that rig bridge printed" in refused.value.response.body
        for head in ({}, {"origin": own}):
            with connect(made.address, **head):
                pass
        with pytest.raises(ConnectionRefusedError):  # another address of this machine
            socket.create_connection(("127.0.0.2", made.port), timeout=5.0).close()


@pytest.mark.parametrize(
    ("message", "told"),
    [
        ("{nope", "is not JSON"),
        ("[1]", "not JSON|expected a JSON object|object"),
        (b"\xff", "not JSON"),
        ('{"do": "admit", "do": "act"}', "'do' is given twice"),
        ('{"do": "act", "values": [NaN]}', "not a finite number"),
        ('{"do": "dance"}', "\"do\" is 'dance'; it can be act, subscribe, admit, ask"),
        ("{}", "\"do\" is 'None'"),
        ('{"do": "act", "tick": 0, "values": [1.0]}', "no controller is admitted on this connection"),
        ('{"do": "subscribe", "topics": "state"}', "\"topics\" is 'state'; expected a list of patterns"),
        ('{"do": "ask", "topic": "param/plant", "body": {"get": ["load.forse"]}}', "load.forse"),
        ('{"do": "ask", "topic": "nonsense"}', "no topic is called 'nonsense'"),
        ('{"do": "ask", "topic": 3}', 'expected {"do": "ask"'),
        (json.dumps({**ADMIT, "reads": ["laser2"]}), "there is no sensor laser2"),
        (json.dumps({**ADMIT, "drives": ["load.mass"]}), "load.mass: there is no such actuator"),
        (json.dumps({**ADMIT, "period_ns": 1}), "no whole number of 1 ms frames"),
        (json.dumps({**ADMIT, "period_ns": "1 ms"}), "period_ns: "),
        (json.dumps({**ADMIT, "controller": "a/b"}), "a/b"),
        (json.dumps({**ADMIT, "controller": None}), '"controller" is None; expected a name'),
        (json.dumps({**ADMIT, "hears": True}), '"hears" is not possible over the bridge'),
    ],
)
def test_nonsense_is_answered_with_the_reason_and_the_connection_lives(at_rest, message, told):
    with client_of(at_rest) as client:
        client.socket.send(message)
        answer = client.get()
        assert answer.keys() <= {"error", "id"}, answer
        assert any(one in answer["error"] for one in told.split("|")), answer
        assert client.ask(do="ask", topic="param/plant", body={"get": ["load.force"]}, id=7)["id"] == 7


@pytest.fixture(scope="module")
def at_rest(tmp_path_factory):
    """The bridge of a run that waits for a controller which never comes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("r")))
        with bridged() as (_, made):
            yield made


def test_a_controller_sees_steps_and_a_viewer_messages(runs):
    with bridged("it") as (run, made), client_of(made) as viewer, client_of(made) as it:
        assert viewer.ask(do="subscribe", topics=["meas/vibrometer", "state", "applied/it"]) == {"answer": {}}
        assert "subscribed already" in viewer.ask(do="subscribe", topics=["**"])["error"]
        assert it.ask(**ADMIT)["answer"] == {"tick": 0, "t_ns": 0}
        heard, t_ns = {}, []
        while "ended" not in (message := it.get()):
            if (step := message.get("step")) is None:
                continue
            t_ns.append(step["t_ns"])
            if step["tick"] == 3:
                assert "is that of no step" in it.ask(do="act", tick=99, values=[1.0])["error"]
                assert "1 numbers, one for each actuator" in it.ask(do="act", tick=3, values=[1.0, 2.0])["error"]
            it.send(do="act", tick=step["tick"], values=[20.5])
        assert message == {"ended": RUN}
        with pytest.raises(ConnectionClosed):
            it.get()
        assert t_ns == [k * 1_000_000 for k in range(300)]
        while "ended" not in (message := viewer.get()):
            heard.setdefault(message["topic"], []).append(message)
    assert run.summary["loop"]["it"]["taken"] == 300
    assert {one["message"]["values"][0] for one in heard["applied/it"]} == {20.5}
    assert heard["state"][1]["message"]["t_ns"] == heard["state"][1]["t_ns"] == 5_000_000
    assert isinstance(heard["state"][1]["message"]["velocity"], float)
    assert sum(len(one["message"]["v"]) for one in heard["meas/vibrometer"]) >= 290
    assert heard["state"][-1]["lost"] == 0


def test_steps_go_first_and_an_unanswered_one_is_replaced_by_the_newest_in_a_paced_run(runs):
    asleep_s = 0.4
    with bridged("it", seconds=1.5, pace=1.0) as (_, made), client_of(made) as it:
        it.ask(do="subscribe", topics=["**"])
        it.send(**ADMIT)
        steps, others, kinds = [], [], []
        while "ended" not in (message := it.get()):
            kinds.append(message)
            if (step := message.get("step")) is None:
                others += [message] if "topic" in message else []
                continue
            steps.append(step)
            if len(steps) == 1:
                it.send(do="act", tick=step["tick"], values=[10**400])
                time.sleep(asleep_s)
            it.send(do="act", tick=step["tick"], values=[20.0])
    (refused,) = [message["error"] for message in kinds if "error" in message]
    assert "1 numbers, one for each actuator" in refused
    (admitted,) = [message["answer"] for message in kinds if message.get("answer")]
    ticks = [step["tick"] for step in steps]
    assert ticks == sorted(set(ticks))
    assert ticks[-1] - admitted["tick"] + 1 == len(steps) + steps[-1]["left_out"]
    # while it slept it got few steps, at growing intervals, and few messages beside each; then the newest step
    assert ticks[8] - ticks[0] > 100
    asleep = kinds[kinds.index({"step": steps[0]}) : kinds.index({"step": steps[8]})]
    assert len(asleep) <= 8 * (1 + bridge_client.AHEAD) + 1  # the refusal
    assert {one["topic"] for one in others} >= {"meas/vibrometer", "state", "applied/it"}
    assert sum(len(one["message"]["v"]) for one in others if one["topic"] == "meas/vibrometer") > 1000


def test_a_client_that_dies_leaves_the_run_and_the_run_goes_on(runs):
    with bridged("it", seconds=0.5) as (run, made):
        with client_of(made) as it:
            it.ask(**ADMIT)
            for _ in range(5):
                it.send(do="act", tick=it.get()["step"]["tick"], values=[21.0])
            it.socket.socket.close()
        no_client(made)
        run.thread.join(20.0)
    assert run.summary["ended"] == "done"
    assert run.summary["loop"]["it"]["taken"] >= 5
    assert run.summary["loop"]["it"]["safe"] == 1  # its last command was held, then the safe value took over


def test_a_client_that_does_not_read_is_disconnected_and_delays_nobody(runs, monkeypatch):
    monkeypatch.setattr(bridge, "SEND_S", 1)
    with bridged(None, seconds=1e6) as (run, made), client_of(made) as other:
        with socket.create_connection(("127.0.0.1", made.port)) as hung:
            hung.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            path = made.address.partition(str(made.port))[2]
            head = (
                f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{made.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            )
            hung.sendall(f"{head}Sec-WebSocket-Key: {'A' * 22}==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
            asked = b'{"do": "subscribe", "topics": ["**"]}'
            hung.sendall(bytes([0x81, 0x80 | len(asked), 0, 0, 0, 0]) + asked)
            deadline = time.monotonic() + 20.0
            while len(made.clients) > 1 or time.monotonic() < deadline - 19.5:
                assert time.monotonic() < deadline
                begin = time.monotonic()
                assert "answer" in other.ask(do="ask", topic="param/plant", body={"get": ["load.force"]})
                assert time.monotonic() - begin < 5.0
                time.sleep(0.05)
        run.end()


def test_too_many_clients_and_a_used_port_are_refused(runs, monkeypatch):
    monkeypatch.setattr(bridge, "CLIENTS", 1)
    with bridged() as (_, made):
        with client_of(made) as first:
            first.ask(do="ask", topic="scene")
            with pytest.raises(InvalidStatus) as refused, client_of(made):
                pass
            assert refused.value.response.status_code == 503
    monkeypatch.setattr(bridge, "CLIENTS", 8)
    with bridged() as (_, made), ExitStack() as stack:
        together = threading.Barrier(14)

        def come(_):
            together.wait(10.0)
            try:
                return stack.enter_context(connect(made.address))
            except InvalidStatus as refused:
                return refused.response.status_code

        with ThreadPoolExecutor(14) as pool:
            came = list(pool.map(come, range(14)))
        assert came.count(503) == 6
        next(one for one in came if one != 503).close()
        no_client(made, 7)
        with connect(made.address):  # the seat is free again
            pass
        with pytest.raises(UsageError, match=f"--port {made.port}: cannot be used"):
            Bridge(RUN, made.port)


def test_the_command_prints_the_address_and_needs_a_run(rig, runs):
    code, _, err = rig("bridge")
    assert code == 2
    assert "no run is live" in err
    with waiting_run("nobody") as run:
        threading.Timer(1.0, run.end).start()  # it ends with the run
        code, out, err = rig("bridge", "--json")
    assert code == 0, err
    found = json.loads(out)
    assert found["run"] == RUN
    assert found["address"].startswith("ws://127.0.0.1:")
