"""The bus over WebSocket: the same checks, a controller in JavaScript, clients that die or send nonsense."""

import json
import shutil
import socket
import subprocess
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
from patience import PATIENCE_S, wait_for
from waiting_run import RUN, in_process, waiting_run
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from rig.web import bridge
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
        return json.loads(self.socket.recv(PATIENCE_S))

    def ask(self, **message):
        self.send(**message)
        return self.get()

    def until_end(self):
        """The messages of topics, and the last one."""
        messages = []
        while "ended" not in (message := self.get()):
            messages.append(message)
        return messages, message


@contextmanager
def bridged(expected="nobody", seconds=0.3, pace=None):
    with waiting_run(expected, seconds, pace) as run, Bridge(RUN) as made:
        yield run, made


@contextmanager
def client_of(made):
    with connect(made.address, compression=None, open_timeout=PATIENCE_S) as socket:
        yield Client(socket)


def _websocket():
    """How node is started so that it has WebSocket; None if it has none."""
    for flags in ([], ["--experimental-websocket"]):
        if NODE:
            asked = subprocess.run([NODE, *flags, "-p", "typeof WebSocket"], capture_output=True, text=True)
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
            said, wrong = process.communicate(timeout=PATIENCE_S)
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
            (made.address[:-1], {}),
            (made.address, {"origin": "http://evil.example"}),
            (made.address, {"origin": f"http://127.0.0.1:{made.port + 1}"}),
            (made.address, {"additional_headers": {"Host": "evil.example"}}),
        ):
            with pytest.raises(InvalidStatus) as refused, connect(address, **head):
                pass
            assert refused.value.response.status_code == 403
            assert b"Open the address that rig live bridge printed" in refused.value.response.body
        for head in ({}, {"origin": own}):
            with connect(made.address, **head):
                pass
        with pytest.raises(ConnectionRefusedError):  # another address of this machine
            socket.create_connection(("127.0.0.2", made.port), timeout=5.0).close()


def test_nonsense_is_answered_with_the_reason_and_the_connection_lives(runs):
    said = (
        ("{nope", "is not JSON"),
        ('{"do": "act", "values": [NaN]}', "not a finite number"),
        ('{"do": "dance"}', "\"do\" is 'dance'; it can be act, subscribe, admit, ask"),
        ('{"do": "act", "tick": 0, "values": [1.0]}', "no controller is admitted on this connection"),
        ('{"do": "subscribe", "topics": "state"}', "\"topics\" is 'state'; expected a list of patterns"),
        ('{"do": "ask", "topic": "param/plant", "body": {"get": ["load.forse"]}}', "load.forse"),
        ('{"do": "ask", "topic": 3}', 'expected {"do": "ask"'),
        (json.dumps({**ADMIT, "reads": ["laser2"]}), "there is no sensor laser2"),
        (json.dumps({**ADMIT, "hears": True}), '"hears" is not possible over the bridge'),
    )
    with bridged() as (_, made), client_of(made) as client:
        for message, told in said:
            client.socket.send(message)
            answer = client.get()
            assert answer.keys() <= {"error", "id"}, answer
            assert told in answer["error"]
        assert client.ask(do="ask", topic="param/plant", body={"get": ["load.force"]}, id=7)["id"] == 7


def test_a_controller_sees_steps_and_a_viewer_messages_and_what_it_lost(runs):
    with bridged("it") as (run, made), client_of(made) as viewer, client_of(made) as it, ThreadPoolExecutor(1) as pool:
        assert viewer.ask(do="subscribe", topics=["meas/vibrometer", "state", "applied/it"]) == {"answer": {}}
        assert "subscribed already" in viewer.ask(do="subscribe", topics=["**"])["error"]
        seen = pool.submit(viewer.until_end)
        assert it.ask(**ADMIT)["answer"] == {"tick": 0, "t_ns": 0}
        for k in range(300):
            step = it.get()["step"]
            assert step["t_ns"] == k * 1_000_000
            if k == 3:
                assert "is that of no step" in it.ask(do="act", tick=99, values=[1.0])["error"]
                assert "is not a finite number" in it.ask(do="act", tick=3, values=[10**400])["error"]
                assert "1 numbers, one for each actuator" in it.ask(do="act", tick=3, values=[1.0, 2.0])["error"]
            it.send(do="act", tick=step["tick"], values=[20.5])
        assert it.get() == {"ended": RUN}
        with pytest.raises(ConnectionClosed):
            it.get()
        messages, end = seen.result(PATIENCE_S)
    assert run.summary["loop"]["it"]["taken"] == 300
    heard = {
        topic: [message for message in messages if message["topic"] == topic]
        for topic in {m["topic"] for m in messages}
    }
    assert {message["message"]["values"][0] for message in heard["applied/it"]} == {20.5}
    assert {message["message"]["t_ns"] - message["t_ns"] for message in heard["state"]} == {0}
    assert isinstance(heard["state"][1]["message"]["velocity"], float)
    assert any(message["message"]["v"] for message in heard["meas/vibrometer"])
    missing = sum(of_one[-1]["seq"] - of_one[0]["seq"] + 1 - len(of_one) for of_one in heard.values())
    assert missing <= end.get("lost", 0)


def test_a_client_that_dies_leaves_the_run_and_the_run_goes_on(runs):
    with bridged("it", seconds=0.5) as (run, made):
        with client_of(made) as it:
            it.ask(**ADMIT)
            for _ in range(5):
                message = it.get()
                assert "step" in message, message
                it.send(do="act", tick=message["step"]["tick"], values=[21.0])
            it.socket.socket.close()
        wait_for(lambda: not made.clients)
        run.thread.join(PATIENCE_S)
    assert run.summary["ended"] == "done"
    assert run.summary["loop"]["it"]["taken"] >= 5
    assert run.summary["loop"]["it"]["safe"] == 1  # its last command was held, then the safe value took over


def test_the_command_prints_the_address_and_ends_with_the_run(rig, runs, monkeypatch):
    code, _, err = rig("live", "bridge")
    assert code == 2
    assert "no run is live" in err
    with waiting_run("nobody") as run:
        is_live = bridge.address.is_live
        monkeypatch.setattr(bridge.address, "is_live", lambda name: run.end() or is_live(name))
        code, out, err = rig("live", "bridge", "--json")
    assert code == 0, err
    told = json.loads(out)
    assert told["run"] == RUN
    assert told["address"].startswith("ws://127.0.0.1:")
