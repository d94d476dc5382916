"""Files that are no whole recording, given to every command that reads one: each says in words what is wrong with which
file, and what can still be read.
"""

from pathlib import Path

import pytest
from mcap.writer import Writer as OtherWriter

import rig as lab
from rig.cli import app
from rig.errors import LogError
from rig.record.mcap_writer import Writer
from rig.record.message_scan import Scan

BELT = Path(__file__).parents[2] / "recordings" / "golden" / "belt.mcap"
TAKES = {
    "note": ("a note",),
    "diff": (BELT,),
    "export": ("--to", "csv", "--out", "tables"),
    "analyse response": ("--input", "vibrometer", "--output", "velocity"),
    "view": ("--save", "view.rrd", "--force"),
    "live replay": ("--pace", "max"),
}
"""What a command needs beside the recording."""
COMMANDS = sorted(
    name
    for name, command in app.every().items()
    if any(getattr(one.callback, "__name__", "") == "recording" for one in command.params)
)


def rewritten(path, without="nothing", form="1"):
    """A recording without a topic, or in another format; its checksums are right."""
    scan = Scan(BELT)
    messages = list(scan)
    described = {channel.topic: channel for channel in scan.channels.values()}
    with path.open("wb") as file:
        out, channels = Writer(file, 1 << 18), {}
        for one in scan.attachments.values():
            out.attach(one.name, one.media_type, one.data, one.log_time)
        for name, values in scan.metadata.items():
            out.note(name, {**values, "format": form} if name == "log" else values)
        for topic, payload, t_ns, seq, wall_ns in messages:
            if topic.startswith(without):
                continue
            if topic not in channels:
                made = described[topic]
                schema = scan.schemas[made.schema_id]
                number = out.schema(schema.name, schema.encoding, schema.data)
                channels[topic] = out.channel(topic, made.message_encoding, number, made.metadata)
            out.add(channels[topic], t_ns, payload, wall_ns, seq)
        out.finish()


NOTHING = {
    "empty": "the file is empty",
    "text": "it is not an MCAP file: it begins with the bytes 68 65 6c 6c",
    "head": "it breaks off before the description of its run",
    "ros2": "it is an MCAP file of another program (profile 'ros2' and library 'rosbag2'; its channels: /imu)",
    "newer": "is a recording of format 99, written by a newer version",
    "folder": "it is a folder",
    "absent": "No such file",
}
"""Files of which nothing can be read -> what is said."""
PART = {
    "block": "of its 771 messages are missing",
    "cut": "it breaks off after t = ",
    "no_velocity": "no message of truth/velocity is in it; the other channels can be read",
    "no_outputs": "no message of truth/velocity, truth/displacement, truth/acceleration, ",
    "no_sensor": "no message of meas/vibrometer is in it",
}
"""Files of which a part can be read -> what is said."""


@pytest.fixture(scope="module")
def bad(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    whole = BELT.read_bytes()
    middle = bytearray(whole)
    middle[len(whole) // 2 : len(whole) // 2 + 200] = bytes(200)
    contents = {
        "empty": b"",
        "text": b"hello, this is not a recording at all",
        "head": whole[:60],
        "block": middle,
        "cut": whole[: len(whole) // 2],
    }
    for name, data in contents.items():
        (folder / name).write_bytes(data)
    (folder / "folder").mkdir()
    out = OtherWriter(str(folder / "ros2"))
    out.start(profile="ros2", library="rosbag2")
    channel = out.register_channel("/imu", "json", out.register_schema("sensor_msgs/msg/Imu", "jsonschema", b"{}"))
    out.add_message(channel, 0, b"{}", 0)
    out.finish()
    rewritten(folder / "newer", form="99")
    rewritten(folder / "no_velocity", without="truth/velocity")
    rewritten(folder / "no_outputs", without="truth/")
    rewritten(folder / "no_sensor", without="meas/")
    assert {path.name for path in folder.iterdir()} | {"absent"} == NOTHING.keys() | PART.keys()
    return folder


@pytest.fixture
def call(rig, tmp_path, monkeypatch, runs):
    """Runs a command on a file in an empty folder: exit code and what was said, in one line."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "1000")

    def judge(command, *given):
        code, out, err = rig(*command.split(), *given, *TAKES.get(command, ()))
        assert "Traceback" not in out + err
        return code, " ".join((out + err).split())

    return judge


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_that_reads_a_recording_names_what_is_none(call, bad, command):
    code, said = call(command, bad / "text")
    assert code == 2
    assert f"{bad / 'text'}" in said
    assert NOTHING["text"] in said


@pytest.mark.parametrize("kind", NOTHING)
def test_what_is_no_recording_is_named_with_what_it_is(call, bad, kind):
    for command in (("analyse amplitude",), ("simulate", "--duration", "0.1", "--from")):
        code, said = call(*command, bad / kind)
        assert (code, str(bad / kind) in said) == (2, True)
        assert NOTHING[kind] in said or (kind == "absent" and "no such" in said)
    with pytest.raises(LogError) as refused:
        lab.open(bad / kind)
    assert str(bad / kind) in str(refused.value)
    assert NOTHING[kind] in str(refused.value) or kind == "folder"


@pytest.mark.parametrize("command", sorted(set(COMMANDS) - {"note", "recover"}))
def test_every_command_says_what_a_recording_lacks(call, bad, command):
    code, said = call(command, bad / "cut")
    assert code in (0, 1, 2)
    assert str(bad / "cut") in said or code == 0
    assert PART["cut"] in said


@pytest.mark.parametrize("kind", PART)
def test_what_lacks_something_is_read_and_not_verified(call, bad, kind):
    run = lab.open(bad / kind)
    assert PART[kind] in run.damage
    assert run.scene == lab.open(BELT).scene
    code, said = call("verify", bad / kind)
    assert code == 1
    assert f"{bad / kind}: not verified {run.damage}" in said


def test_python_reads_what_is_left(bad):
    whole = lab.open(BELT)
    assert lab.open(bad / "no_velocity").signals.keys() == whole.signals.keys() - {"velocity"}
    assert lab.open(bad / "no_sensor").signals["velocity"].tobytes() == whole.signals["velocity"].tobytes()
    assert lab.open(bad / "no_outputs").measurements["vibrometer"].v.size == 201
    assert lab.open(bad / "cut").time[-1] > 0.9


def test_recover_and_verify_mean_the_same_by_whole(rig, tmp_path):
    whole = tmp_path / "whole.mcap"
    assert rig("simulate", "pendulum", "--duration", "0.2", "--out", whole)[0] == 0
    data = whole.read_bytes()
    cases = {"whole": data, **{f"cut by {n}": data[:-n] for n in (1, 20, len(data) // 3)}}
    for at in (3, 9, len(data) // 2, len(data) - 10):
        wrong = bytearray(data)
        wrong[at] ^= 0x10
        cases[f"wrong at {at}"] = bytes(wrong)
    for name, content in cases.items():
        path = tmp_path / "case.mcap"
        path.write_bytes(content)
        verified, _, _ = rig("verify", path)
        _, _, said = rig("recover", path, "--out", tmp_path / "copy.mcap", "--force")
        assert (verified == 0) == ("is whole; there is nothing to recover" in said) == (name == "whole"), name
