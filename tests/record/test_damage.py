"""Damaged recordings: one wrong byte is always noticed, costs less than 5 % of the messages, and is told."""

import random
import re

import pytest
from full_disk import largest_file
from mcap.reader import make_reader
from small_recording import record, walked

from rig.errors import OutputError
from rig.record import mcap_writer, reader
from rig.record.recorded_setup import setup_of


def frames(path):
    """Where records, chunks and their lengths begin: the bytes on which the rest hangs."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    starts = [c.chunk_start_offset for c in summary.chunk_indexes[::60]]
    starts += [i.offset for i in (*summary.attachment_indexes, *summary.metadata_indexes)]
    starts += [c.chunk_start_offset + c.chunk_length for c in summary.chunk_indexes[::60]]
    return [start + k for start in starts for k in (0, 1, 30, 45)]


def test_one_wrong_byte_costs_less_than_a_twentieth(logs, tmp_path):
    draw, path = random.Random(1), tmp_path / "wrong.mcap"
    for name in ("saved.mcap", "killed.mcap"):
        whole = (logs / name).read_bytes()
        before, given = walked(logs / name)
        places = [0, 4, len(whole) - 20, len(whole) - 1, *(draw.randrange(len(whole)) for _ in range(4))]
        for place in [*places, *(frames(logs / name)[::3] if before.whole else ())]:
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
        out = mcap_writer.Writer(file, 8192)
        out.attach("scene.json", "application/json", b"{}", 0)
        out.note("log", {"made": "recorded"})
        channel = out.channel("state", "protobuf", out.schema("rig.State", "protobuf", b"schema"), {"x": "m"})
        for k in range(3):
            out.add(channel, k, b"payload", k, k)
        out.finish()
    whole = path.read_bytes()
    assert walked(path)[0].sealed
    for place in range(0, len(whole), 2):
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


def test_a_disk_that_is_full_at_any_moment_leaves_what_was_written(tmp_path):
    record(tmp_path / "whole.mcap", 60)
    given = walked(tmp_path / "whole.mcap")[1]
    size = (tmp_path / "whole.mcap").stat().st_size
    for limit in (*range(0, size, size // 4), size - 1):
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
