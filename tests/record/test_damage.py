"""Damaged recordings: one wrong byte is always noticed, costs less than 5 % of the messages, and is told."""

import contextlib
import json
import random
import re

import numpy as np
import pytest
from full_disk import largest_file
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer as PlainWriter
from twin import Twin

from rig.bus import encode, messages
from rig.bus.run_setup import Setup
from rig.errors import BusError, LogError, OutputError, UsageError
from rig.record import mcap_file, reader, writer
from rig.record.byte_scan import walk
from rig.record.compare import compare
from rig.record.message_scan import Scan
from rig.record.recorded_setup import setup_of
from rig.record.recover import recover
from rig.record.replay import replay
from rig.record.save_run import save
from rig.record.writer import Writer

SETUP = Setup("r", '{"plant": "belt"}', 1_000_000, 1_000_000, {"x": "m"}, {"s": ("m", 1_000_000)})


def walked(path):
    scan = Scan(path)
    return scan, list(scan)


def record(path, count, finished=True):
    """Messages as the recorder gets them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "FLUSH_NS", 0)  # due whenever it is asked
        log, state = Writer(path, SETUP, "recorded"), encode.StateEncoder(1)
    try:
        for k in range(count):
            now = k * 1_000_000
            log.write("step", encode.step(k, now, np.array([float(k)]), np.ones(1, np.int64)), now, k, now)
            log.write("state", state(now, k, 0, np.array([k * 0.5])), now, k, now)
            log.write("meas/s", encode.block(k, now, 1_000_000, [float(k)]), now, k, now)
        if finished:
            log.close({"messages": log.messages}, {"verdict": "VALID"})
        else:
            log.flush_if_due()
    finally:
        log.abandon()


@pytest.fixture(scope="module")
def logs(run, tmp_path_factory):
    """A saved run, and a recorded one whose recorder was killed."""
    folder = tmp_path_factory.mktemp("logs")
    save(run, folder / "saved.mcap")
    record(folder / "killed.mcap", 400, finished=False)
    return folder


def frames(path):
    """Where records, chunks and their lengths begin: the bytes on which the rest hangs."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    starts = [c.chunk_start_offset for c in summary.chunk_indexes[::20]]
    starts += [i.offset for i in (*summary.attachment_indexes, *summary.metadata_indexes)]
    starts += [c.chunk_start_offset + c.chunk_length for c in summary.chunk_indexes[::20]]
    return [start + k for start in starts for k in (0, 1, 4, 30, 45)]


def test_one_wrong_byte_costs_less_than_a_twentieth(logs, tmp_path):
    draw, path = random.Random(1), tmp_path / "wrong.mcap"
    for name in ("saved.mcap", "killed.mcap"):
        whole = (logs / name).read_bytes()
        before, given = walked(logs / name)
        places = [
            *range(12),
            *(len(whole) - 1 - k for k in range(0, 60, 2)),
            *(draw.randrange(len(whole)) for _ in range(40)),
        ]
        for place in [*places, *(frames(logs / name) if before.whole else ())]:
            data = bytearray(whole)
            data[place] ^= draw.randrange(1, 256)
            path.write_bytes(data)
            scan, kept = walked(path)
            assert len(kept) >= 0.95 * len(given), place
            assert set(kept) <= set(given), place  # never a wrong one
            if before.whole:
                assert not scan.whole, place
                assert scan.missing == len(given) - len(kept), place
            assert setup_of(scan) == setup_of(before), place


def test_every_single_byte_is_covered_by_a_checksum(tmp_path):
    path = tmp_path / "small.mcap"
    with path.open("wb") as file:  # all kinds of records in 2 kB
        out = mcap_file.Writer(file, 8192)
        out.attach("scene.json", "application/json", b"{}", 0)
        out.note("log", {"made": "recorded"})
        channel = out.channel("state", "protobuf", out.schema("rig.State", "protobuf", b"schema"), {"x": "m"})
        for k in range(3):
            out.add(channel, k, b"payload", k, k)
        out.finish()
    whole = path.read_bytes()
    assert walked(path)[0].sealed
    for place in range(len(whole)):
        data = bytearray(whole)
        data[place] ^= 1 << place % 8
        path.write_bytes(data)
        scan, _ = walked(path)
        assert scan.fault, place
        assert not scan.sealed, place
        assert not scan.whole, place
    for data in (whole + b"\0", b"\0" + whole, whole[:-1], whole[1:]):
        path.write_bytes(data)
        assert walked(path)[0].fault


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


@pytest.mark.parametrize("later", [False, True], ids=["at once", "at the end"])
@pytest.mark.parametrize("killed", [False, True])
def test_a_chunk_that_stands_there_twice_is_kept_once_and_told(logs, tmp_path, later, killed):
    source, path = logs / ("killed.mcap" if killed else "saved.mcap"), tmp_path / "twice.mcap"
    whole = source.read_bytes()
    chunks = [part for part in walk(whole) if getattr(part, "opcode", 0) == Opcode.CHUNK]
    first, last = chunks[0], chunks[-1]
    place = last.end if later else first.end
    path.write_bytes(whole[:place] + whole[first.begin : first.end] + whole[place:])
    done = recover(path)
    given = walked(source)[1]
    assert walked(tmp_path / "twice.recovered.mcap")[1] == given == walked(path)[1]
    assert any("a copy of a chunk before it, after t = " in told for told in done.skipped)
    if not killed:
        assert (done.lost, done.fault) == (0, "a chunk is in it twice; no message is missing")
        assert reader.open(path).damage == done.fault


def test_damage_outside_of_the_messages_costs_none(logs, run, tmp_path):
    whole = (logs / "saved.mcap").read_bytes()
    for text in (b'"plant"', b"setup.json", b"VALID", b"provenance"):
        data = bytearray(whole)
        data[whole.index(text) + 2] ^= 2
        (tmp_path / "wrong.mcap").write_bytes(data)
        read = reader.open(tmp_path / "wrong.mcap")
        assert "no message is missing" in read.damage, text
        assert compare(run, read).identical
        assert (read.scene, read.units) == (run.scene, run.units)
        done = recover(tmp_path / "wrong.mcap", tmp_path / "again.mcap", replace=True)
        assert done.complete
        assert compare(run, reader.open(done.path)).identical


def test_a_file_that_another_program_has_written_anew_is_not_called_complete(logs, run, tmp_path):
    """Such a program may leave out messages: its index counts those that are there."""
    with (logs / "saved.mcap").open("rb") as file, (tmp_path / "anew.mcap").open("wb") as copy:
        read, out, channels = make_reader(file), PlainWriter(copy), {}
        out.start(read.get_header().profile, "another program")
        for one in read.iter_attachments():
            out.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
        for one in read.iter_metadata():
            out.add_metadata(one.name, dict(one.metadata))
        for schema, channel, one in read.iter_messages():
            if channel.topic == "applied/feedback":
                continue
            if channel.topic not in channels:
                kind = out.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = out.register_channel(channel.topic, channel.message_encoding, kind)
            out.add_message(channels[channel.topic], one.log_time, one.data, one.publish_time, one.sequence)
        out.finish()
    found = reader.open(tmp_path / "anew.mcap")
    assert not found.sealed
    assert "another program has written it again; no message that its index counts is missing" in found.damage
    assert all(np.array_equal(found.signals[name], v) for name, v in run.signals.items())
    done = recover(tmp_path / "anew.mcap")
    assert done.skipped == ["nothing: every record was read, but its header or an index is not as it was recorded"]


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


def test_a_recording_of_an_older_version_has_no_digest_and_is_not_called_whole(logs, tmp_path):
    scan, old = Scan(logs / "saved.mcap"), tmp_path / "old.mcap"
    with old.open("wb") as file:
        out = PlainWriter(file)
        out.start("friction-rig", "friction-rig")
        channels = {}
        for message in scan.messages():
            for one in scan.attachments.values() if not channels else ():
                out.add_attachment(0, 0, one.name, one.media_type, one.data)
            if message.channel_id not in channels:
                made = scan.channels[message.channel_id]
                channels[made.id] = out.register_channel(made.topic, made.message_encoding, 0, made.metadata)
            out.add_message(channels[message.channel_id], message.log_time, message.data, message.publish_time)
        out.finish()
    assert (walked(old)[0].whole, walked(old)[0].sealed) == (True, False)
    assert not reader.open(old).damage
    with pytest.raises(LogError, match=r"has no digest \(.*nothing to recover"):
        recover(old)


def test_recover_replaces_neither_its_source_nor_what_is_there(logs, tmp_path):
    cut = tmp_path / "c.mcap"
    cut.write_bytes((logs / "saved.mcap").read_bytes()[:-500])
    for name in ("c.part", "c.recovered.part", "c.recovered.mcap", "other.mcap"):
        (tmp_path / name).write_text("mine")
    (tmp_path / "link.mcap").symlink_to(cut)
    there = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for target in (cut, tmp_path / "link.mcap"):
        for replace in (False, True):
            with pytest.raises(UsageError, match="is the damaged file itself"):
                recover(cut, target, replace)
    for target in (None, tmp_path / "other.mcap"):
        with pytest.raises(UsageError, match="it exists; name another file, or add --force"):
            recover(cut, target)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == there
    recover(cut, tmp_path / "other.mcap", replace=True)
    assert walked(tmp_path / "other.mcap")[0].sealed


def test_a_target_of_the_longest_name_is_written_and_one_beyond_is_told(logs, tmp_path):
    cut, longest = tmp_path / "c.mcap", tmp_path / f"{'x' * 244}.mcap"
    cut.write_bytes((logs / "saved.mcap").read_bytes()[:-500])
    recover(cut, longest)
    assert walked(longest)[0].sealed
    with pytest.raises(OutputError, match="cannot be written: File name too long"):
        recover(cut, tmp_path / f"{'x' * 300}.mcap")
    assert set(tmp_path.iterdir()) == {cut, longest}


def test_a_draft_that_cannot_be_made_leaves_no_empty_target(logs, tmp_path, monkeypatch):
    def refused(*_):
        raise OSError(13, "Permission denied")

    (tmp_path / "c.mcap").write_bytes((logs / "saved.mcap").read_bytes()[:-500])
    monkeypatch.setattr("tempfile.mkstemp", refused)
    with pytest.raises(OutputError, match="Permission denied"):
        recover(tmp_path / "c.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["c.mcap"]


@pytest.mark.parametrize("there", [False, True])
def test_recover_writes_through_a_link(logs, tmp_path, there):
    cut, link, file = (tmp_path / name for name in ("c.mcap", "link.mcap", "file.mcap"))
    cut.write_bytes((logs / "saved.mcap").read_bytes()[:-500])
    link.symlink_to(file)
    if there:
        file.write_text("mine")
        with pytest.raises(UsageError, match="it exists"):
            recover(cut, link)
    recover(cut, link, replace=there)
    assert link.is_symlink()
    assert walked(file)[0].sealed
    assert set(tmp_path.iterdir()) == {cut, link, file}
    loop = tmp_path / "loop.mcap"
    loop.symlink_to(loop)
    with pytest.raises(OutputError, match="cannot be written"):
        recover(cut, loop)


def test_a_recovery_that_fails_leaves_nothing_behind(logs, tmp_path, monkeypatch):
    cut = tmp_path / "c.mcap"
    cut.write_bytes((logs / "saved.mcap").read_bytes()[:-500])

    def full(self):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(mcap_file.Writer, "finish", full)
    with pytest.raises(OutputError, match="No space left on device"):
        recover(cut)
    assert [path.name for path in tmp_path.iterdir()] == ["c.mcap"]


def test_exit_code_and_account_tell_what_was_lost(rig, logs, tmp_path):
    whole = (logs / "saved.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    code, out, _ = rig("recover", cut)
    assert code == 1
    assert "an unknown number of messages" in out
    cut.write_bytes(whole[:-1])
    code, out, _ = rig("recover", cut, "--force", "--json")
    told = json.loads(out)
    assert (code, told["lost"], told["complete"]) == (0, 0, True)


def test_a_recording_that_lost_its_front_keeps_the_rest_and_tells_the_loss(rig, tmp_path):
    record(tmp_path / "whole.mcap", 400)
    whole, given = (tmp_path / "whole.mcap").read_bytes(), walked(tmp_path / "whole.mcap")[1]
    half = tmp_path / "half.mcap"
    half.write_bytes(whole[len(whole) // 2 :])
    scan, kept = walked(half)
    assert 0 < len(kept) < len(given)
    assert kept == given[-len(kept) :]
    assert scan.missing == len(given) - len(kept)
    code, out, _ = rig("recover", half)
    assert code == 1
    assert f"lost: {scan.missing} of {len(given)} messages" in out
    assert walked(tmp_path / "half.recovered.mcap")[0].sealed


@pytest.mark.parametrize("described", [False, True])
def test_a_front_that_is_lost_without_statistics_is_an_unknown_loss(rig, tmp_path, described):
    record(tmp_path / "whole.mcap", 400)
    data = bytearray((tmp_path / "whole.mcap").read_bytes())
    data[-20] ^= 1  # the footer no longer proves the summary
    half = tmp_path / "half.mcap"
    half.write_bytes(data[200 if described else len(data) // 2 :])
    scan, kept = walked(half)
    assert bool(kept) == described
    assert (scan.missing, scan.whole) == (None, False)
    assert "its beginning is damaged or missing" in scan.fault
    code, out, _ = rig("recover", half)
    assert code == 1
    assert "an unknown number of messages" in out


@pytest.mark.parametrize("at", ["first", "last"])
@pytest.mark.parametrize("ended", [False, True], ids=["end of the messages lost", "end of the messages there"])
def test_chunks_that_are_lost_together_with_the_statistics_are_an_unknown_loss(rig, logs, tmp_path, at, ended):
    data, path = bytearray((logs / "saved.mcap").read_bytes()), tmp_path / "wrong.mcap"
    parts = [part for part in walk(bytes(data)) if getattr(part, "opcode", 0) in (Opcode.CHUNK, Opcode.DATA_END)]
    hit = parts[0 if at == "first" else -2]  # no sequence number has a gap where the first or the last one is lost
    data[hit.begin + 9 : hit.end] = bytes(hit.end - hit.begin - 9)
    if not ended:
        data[parts[-1].begin : parts[-1].end] = bytes(parts[-1].end - parts[-1].begin)
    data[-20] ^= 1  # the footer no longer proves the summary
    path.write_bytes(data)
    scan, kept = walked(path)
    assert len(kept) < len(walked(logs / "saved.mcap")[1])
    assert scan.missing is None
    code, out, _ = rig("recover", path)
    assert code == 1
    assert "missing" in scan.fault
    assert "an unknown number of messages" in out
    assert "no message" not in out


def test_messages_of_channels_that_nothing_describes_are_counted_as_missing(tmp_path):
    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        out = mcap_file.Writer(file, 1 << 20)
        out.attach("scene.json", "application/json", b"{}", 0)
        out.counts[1] = 0  # a channel that is described nowhere
        for k in range(9):
            out.add(1, k, b"payload", k, k)
        out.flush()
        out.discard()
    scan, kept = walked(path)
    assert (kept, scan.missing) == ([], None)
    assert "before that 9 messages are missing" in scan.fault


def test_a_wrong_kind_of_a_chunk_costs_nothing_and_is_told_where_it_is(logs, tmp_path):
    with (logs / "saved.mcap").open("rb") as file:
        starts = {"saved.mcap": make_reader(file).get_summary().chunk_indexes[-1].chunk_start_offset}
    starts["killed.mcap"] = next(
        part.begin for part in walk((logs / "killed.mcap").read_bytes()) if getattr(part, "opcode", 0) == Opcode.CHUNK
    )
    for name, start in starts.items():
        data = bytearray((logs / name).read_bytes())
        data[start] = 0x86
        (tmp_path / name).write_bytes(data)
        scan, kept = walked(tmp_path / name)
        assert kept == walked(logs / name)[1]
        assert [(one.begin, one.what) for one in scan.skipped] == [(start, "the frame of a chunk")]


def test_a_cut_is_after_the_last_sample_that_is_there(rig, tmp_path):
    """A saved recording holds samples in blocks of 0.25 s, whose messages have the time of their first sample."""
    whole, cut = tmp_path / "whole.mcap", tmp_path / "cut.mcap"
    assert rig("simulate", "pendulum", "--duration", "1", "--out", whole)[0] == 0
    for size in (20_000, 60_000):
        cut.write_bytes(whole.read_bytes()[:size])
        found = reader.open(cut)
        ends = [1e-9 * samples.t_ns[-1] for samples in found.measurements.values() if samples.t_ns.size]
        end = max(0.0, *ends, *found.time[-1:])
        assert end > 0.2
        assert f"it breaks off after t = {end:.3f} s" in found.damage


def test_every_command_that_reads_a_cut_file_says_so(rig, logs, tmp_path):
    whole = (logs / "killed.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 9 // 10])
    for command in (["explain", cut], ["amplitude", cut], ["diff", cut, cut], ["replay", cut, "--pace", "max"]):
        _, _, err = rig(*command)
        assert "breaks off after t = 0." in err, command


def test_a_disk_that_is_full_at_any_moment_leaves_what_was_written(tmp_path):
    record(tmp_path / "whole.mcap", 60)
    given = walked(tmp_path / "whole.mcap")[1]
    size = (tmp_path / "whole.mcap").stat().st_size
    for limit in (*range(0, size, size // 12), size - 1):
        path = tmp_path / "full.mcap"
        told = r"full\.mcap cannot be written: File too large"
        with largest_file(limit), pytest.raises(OutputError, match=told) as told:
            record(path, 60)
        data = path.read_bytes()
        assert len(data) <= limit
        if b"setup.json" in data:
            scan, kept = walked(path)
            assert scan.fault
            assert [one.payload for one in kept] == [one.payload for one in given][: len(kept)]
            end = re.search(r"recorded up to t = ([\d.]+) s", str(told.value))
            assert (end[1] if end else "0.000") == f"{scan.last_ns * 1e-9:.3f}"


def test_what_cannot_be_decoded_does_not_end_a_replay(tmp_path):
    path, log = tmp_path / "run.mcap", Writer(tmp_path / "run.mcap", SETUP, "recorded")
    for k in range(10):
        now = k * 1_000_000
        log.write("step", encode.step(k, now, np.array([0.0]), np.ones(1, np.int64)), now, k, now)
    for topic in ("step", "act/c", "nonsense/x"):
        with contextlib.suppress(BusError):  # the writer has no type for what is not in the table
            log.write(topic, b"\xff\xff garbage", 9_000_000, 10, 0)
    log.close({}, {})
    found = replay(Twin("replay").open("plant", "plant"), path)
    assert found.steps == 10
    assert found.fault == "messages that cannot be decoded: 1 on act/c, 1 on step"
