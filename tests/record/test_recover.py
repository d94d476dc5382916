"""Recovery of damaged recordings: what rig recover writes and tells, and what it leaves alone."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from small_recording import SETUP, walked

from rig.bus import encode, messages
from rig.errors import LogError, OutputError, UsageError
from rig.record import reader
from rig.record.compare import compare
from rig.record.recover import recover
from rig.record.writer import Writer


def test_a_recording_with_a_wrong_byte_is_recovered_with_an_account(logs, run, tmp_path):
    with (logs / "saved.mcap").open("rb") as file:
        chunk = make_reader(file).get_summary().chunk_indexes[-1]
    data = bytearray((logs / "saved.mcap").read_bytes())
    data[chunk.chunk_start_offset + 100] ^= 0x10
    path = tmp_path / "wrong.mcap"
    path.write_bytes(data)
    done = recover(path)
    total = len(walked(logs / "saved.mcap")[1])
    assert 0 < done.lost < 0.05 * total
    assert done.messages + done.lost == total
    assert f"{done.lost} of its {total} messages are missing" in done.fault
    assert f"{chunk.chunk_length} bytes from byte {chunk.chunk_start_offset} on: a chunk" in done.skipped[0]
    assert not done.complete
    scan, kept = walked(tmp_path / "wrong.recovered.mcap")
    assert (scan.sealed, len(kept)) == (True, done.messages)
    assert reader.open(done.path).recovered.endswith(f"lost: {done.lost} of {total} messages")


def test_messages_are_within_reach_when_every_description_is_damaged(logs, run, tmp_path):
    data = (logs / "saved.mcap").read_bytes().replace(b'"plant"', b'"plamt"').replace(b'"frame_ns"', b'"frame_ms"')
    (tmp_path / "wrong.mcap").write_bytes(data)
    read = reader.open(tmp_path / "wrong.mcap")
    assert compare(run, read).identical
    assert (read.scene, read.frame_ns, read.units) == ("", run.frame_ns, run.units)
    with pytest.raises(LogError, match="lost its scene"):
        read.scene_text()
    done = recover(tmp_path / "wrong.mcap")
    assert done.complete
    assert compare(run, reader.open(done.path)).identical


def test_what_cannot_be_decoded_is_named_counted_and_left_out(tmp_path):
    path, log = tmp_path / "run.mcap", Writer(tmp_path / "run.mcap", SETUP, "recorded")
    state = encode.StateEncoder(1)
    for k in range(100):
        log.write("state", state(k, k, 0, np.array([1.0])), k * 1_000_000, k, 0)
        log.write("meas/s", encode.block(k, k * 1_000_000, 1_000_000, [1.0]), k * 1_000_000, k, 0)
    for topic in ("state", "state", "meas/s", "event/x", "step", "health", "act/y", "applied/y", "total/z"):
        log.write(topic, b"\xff\xff garbage", 100_000_000, 0, 0)
    log.write("event/x", b'\x32\x02{"', 100_000_000, 0, 0)  # an Event whose data is no JSON
    uneven = messages.TYPES["Applied"](ticks=[1, 2], answers=[1], statuses=[0, 0], values=[1.0, 2.0])
    log.write("applied/y", uneven.SerializeToString(), 100_000_000, 0, 0)
    log.close({}, {})
    read = reader.open(path)
    told = "messages that cannot be decoded: 2 on applied/y, 2 on event/x, 1 on meas/s, 2 on state"
    assert read.damage == told
    assert (read.time.size, read.measurements["s"].v.size) == (100, 100)
    assert compare(read, path).identical
    done = recover(path)
    assert done.lost == 11
    assert "2 on event/x, 1 on health, 1 on meas/s" in done.fault
    assert not reader.open(done.path).damage
    assert reader.open(done.path).time.size == 100


def test_a_recovered_copy_is_called_one(cut):
    copy = recover(cut).path
    with pytest.raises(LogError, match=r"is a copy that rig recover wrote, .*\((no message )?lost"):
        recover(Path(copy))


@pytest.fixture
def cut(logs, tmp_path):
    """A recording that lacks its last bytes."""
    (tmp_path / "c.mcap").write_bytes((logs / "saved.mcap").read_bytes()[:-500])
    return tmp_path / "c.mcap"


def test_recover_replaces_neither_its_source_nor_what_is_there(cut, tmp_path):
    for name in ("c.recovered.mcap", "other.mcap"):
        (tmp_path / name).write_text("mine")
    (tmp_path / "link.mcap").symlink_to(cut)
    there = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for target in (cut, tmp_path / "link.mcap"):
        with pytest.raises(UsageError, match="is the damaged file itself"):
            recover(cut, target, replace=True)
    for target in (None, tmp_path / "other.mcap"):
        with pytest.raises(UsageError, match="it exists; name another file, or add --force"):
            recover(cut, target)
    with pytest.raises(OutputError, match="cannot be written: File name too long"):
        recover(cut, tmp_path / f"{'x' * 300}.mcap")
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == there
    recover(cut, tmp_path / "other.mcap", replace=True)
    assert walked(tmp_path / "other.mcap")[0].sealed
