"""Recordings as files: what is written is read, to the bit, and a cut costs no more than what was cut off."""

import contextlib
import copy
import dataclasses
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader

import rig
from rig.bus import encode, messages
from rig.bus.run_setup import Setup
from rig.errors import LogError
from rig.record import mcap_writer, reader, writer
from rig.record.compare import compare
from rig.record.contents import contents
from rig.record.mcap_file import FORMAT
from rig.record.message_scan import Scan
from rig.record.recover import recover
from rig.record.run import Commands, Run, Samples
from rig.record.run_list import runs
from rig.record.save_run import save
from rig.record.writer import Writer
from rig.scenes import Scene


@pytest.fixture(scope="session")
def saved(run, tmp_path_factory):
    """The run as a file of many small chunks."""
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "CHUNK", 8192)
        save(run, path)
    return path


def test_a_saved_run_comes_back_bit_for_bit(run, saved, tmp_path):
    read = reader.open(saved)
    found = compare(run, read)
    assert found.identical
    assert found.compared > 20_000
    assert np.array_equal(read.mode, run.mode)
    for name in ("scene", "step_ns", "frame_ns", "units", "events", "energy", "summary", "provenance", "fault"):
        assert getattr(read, name) == getattr(run, name), name
    for one, two in zip(run.commands["feedback"], read.commands["feedback"]):
        assert np.array_equal(one, two)
    save(dataclasses.replace(run, fault="diverged at t = 0.7 s"), tmp_path / "run.mcap")
    assert reader.open(tmp_path / "run.mcap").fault == "diverged at t = 0.7 s"


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.integers(0, 2 * 10**9), unique=True, max_size=60),
    st.lists(st.integers(0, 2000), unique=True, max_size=20),
    st.lists(st.floats(), min_size=60, max_size=60),
)
def test_any_times_and_values_survive(tmp_path, times, ticks, values):
    t_ns = np.array(sorted(times), np.int64)
    ticks = np.array(sorted(ticks), np.int64)
    v = np.array(values)
    given = Run(
        scene="{}",
        step_ns=1000,
        frame_ns=1_000_000,
        time=t_ns * 1e-9,
        signals={"x": v[: t_ns.size]},
        units={"x": "m"},
        measurements={"s": Samples(t_ns, v[: t_ns.size])},
        commands={"c": Commands(ticks, ticks - 1, ticks * 0, v[: ticks.size, None])} if ticks.size else {},
    )
    path = tmp_path / "any.mcap"
    save(given, path)
    found = compare(given, path)
    assert found.identical


def holds_nothing_wrong(part, run):
    """Whether every number that was read is the one that was written for that instant."""
    for name, (t_ns, v) in part.measurements.items():
        given = run.measurements[name]
        rows = np.searchsorted(given.t_ns, t_ns)
        if not np.array_equal(given.t_ns[rows], t_ns) or given.v[rows].tobytes() != v.tobytes():
            return False
    rows = np.searchsorted(run.time, part.time - 1e-9)
    known = {name: ~np.isnan(v) for name, v in part.signals.items()}
    return all(np.array_equal(run.signals[name][rows][known[name]], v[known[name]]) for name, v in part.signals.items())


def test_a_file_cut_anywhere_reads_up_to_the_cut(run, saved, tmp_path):
    whole, path = saved.read_bytes(), tmp_path / "cut.mcap"
    front = whole.index(b"provenance") / len(whole) + 0.001
    for share in np.linspace(front, 0.999, 12):
        path.write_bytes(whole[: int(share * len(whole))])
        part = reader.open(path)
        assert part.fault
        assert holds_nothing_wrong(part, run)
        latest = max((t_ns[-1] for t_ns, _ in part.measurements.values() if t_ns.size), default=0)
        assert latest >= (share - 0.1) * 0.7e9 - 250e6  # blocks of 0.25 s
    for end in range(0, int(front * len(whole)), 997):  # so little is left that it may be no recording at all
        path.write_bytes(whole[:end])
        with contextlib.suppress(LogError):
            assert reader.open(path).fault


SETUP = Setup("r", "{}", 1_000_000, 1_000_000, {"x": "m"}, {"s": ("m", 1_000_000)})


def test_log_times_are_simulated_times_in_order_whatever_order_messages_arrive_in(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "FLUSH_NS", 0)  # due whenever it is asked
    log, ms, wall = Writer(tmp_path / "run.mcap", SETUP, "recorded"), 1_000_000, 1_800_000_000 * 10**9
    event = {"tick": 0, "kind": "note", "text": "", "data": {}}
    for k in range(1000):
        if k % 100 == 0:  # it overtakes the samples before it; a stranger states times that cannot be
            stated = (k + 100) * ms
            log.write("event/plant", messages.event(stated, source="plant", **event), stated, k, wall)
            for stated in (0, 2**63):
                log.write("event/nf", messages.event(0, source="nf", **event), stated, k, wall)
        log.write("meas/s", encode.block(k, k * ms, ms, [float(k)]), k * ms, k, wall + 3 * k * ms)
        if k % 200 == 199:
            log.flush_if_due()
    log.close({}, {})
    with (tmp_path / "run.mcap").open("rb") as file:
        found = [
            (channel.topic, message.log_time, message.publish_time)
            for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False)
        ]
        file.seek(0)
        summary = make_reader(file).get_summary()
    logged = [t_ns for _, t_ns, _ in found]
    assert logged == sorted(logged)
    assert [t_ns for topic, t_ns, _ in found if topic == "meas/s"] == [k * ms for k in range(1000)]
    assert [t_ns for topic, t_ns, _ in found if topic == "event/plant"] == [(k + 100) * ms for k in range(0, 1000, 100)]
    assert all(0 <= t_ns <= 1000 * ms for t_ns in logged)
    assert all(wall_ns == wall + 3 * t_ns for topic, t_ns, wall_ns in found if topic == "meas/s")
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (0, 1000 * ms)
    for names in ([one.name for one in summary.attachment_indexes], [one.name for one in summary.metadata_indexes]):
        assert len(set(names)) == len(names)


def test_the_first_difference_is_found_to_the_bit(run):
    run, other = copy.deepcopy(run), copy.deepcopy(run)
    run.signals["velocity"][2] = other.signals["velocity"][2] = np.nan  # equal
    run.signals["velocity"][500], other.signals["velocity"][500] = 0.0, -0.0
    other.signals["displacement"][400] = np.nextafter(run.signals["displacement"][400], np.inf)
    other.commands["feedback"].values[300, 1] = 7.0
    t_ns, v = run.measurements["gauge"]
    other.measurements["gauge"] = Samples(t_ns[:600], v[:600])
    del other.measurements["slow"]
    found = compare(run, other)
    assert not found.identical
    assert found.missing == ("meas/slow",)
    places = [("displacement", 400), ("velocity", 500), ("applied/feedback[1]", 300), ("meas/gauge", 600)]
    assert [(d.topic, d.index) for d in found.differences] == places
    assert found.differences[1].time == pytest.approx(0.05)
    assert "differs at sample 500, t = 0.05 s" in str(found.differences[1])


def test_memory_does_not_grow_with_the_length_of_a_recording(tmp_path, monkeypatch):
    monkeypatch.setattr(mcap_writer, "SPILL", 1 << 12)
    monkeypatch.setattr(writer, "FLUSH_NS", 0)  # due whenever it is asked
    log, payload, taken = Writer(tmp_path / "run.mcap", SETUP, "recorded"), encode.block(0, 0, 1, [0.0]), []
    tracemalloc.start()
    for k in range(700):
        for sensor in range(4):
            log.write(f"meas/s{sensor}", payload, k * 100_000_000, k, k)
        log.flush_if_due()  # a chunk each: as after a day
        if k in (200, 699):
            taken.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    log.close({}, {})
    assert taken[1] - taken[0] < 64 << 10  # bytes; the library's writer keeps 1 kB for each chunk, 0.5 MB here
    with (tmp_path / "run.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert len(summary.chunk_indexes) >= 700
    assert summary.statistics.message_count == 2_800
    scan = Scan(tmp_path / "run.mcap")
    assert sum(1 for _ in scan) == 2_800
    assert scan.sealed


OLD = Path(__file__).parent / "format_1.mcap"
"""rig simulate belt_normal_force --duration 0.3, by the version before recordings stated their format."""
BUS = Path(__file__).parent / "format_1_bus.mcap"
"""rig run belt_normal_force --duration 0.1 --pace max, by the last version whose log times were the wall clock."""


def test_a_recording_of_the_first_format_opens():
    run = reader.open(OLD)
    assert (run.damage, run.sealed) == ("", True)
    assert run.time[-1] == pytest.approx(0.3)
    assert set(run.measurements) == {"vibrometer", "normal_force"}
    assert run.commands["nf"].tick.size == 300
    scene = Scene.from_json(run.scene_text())
    assert (scene.parameters.load.force, scene.controllers["nf"].gain) == (20.0, 200.0)


@pytest.mark.parametrize(("path", "end", "began"), [(OLD, 0.3, "1970"), (BUS, 0.1, "2026")])
def test_times_of_the_first_format_are_those_of_the_run(path, end, began, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-2000])
    recovered = Path(recover(cut).path)
    for file in (path, cut, recovered):
        run = reader.open(file)
        scan = Scan(file)
        assert max(record.t_ns for record in scan) <= scan.last_ns == pytest.approx(end * 1e9)
        assert np.datetime64(run.began_ns, "ns").astype("datetime64[Y]") == np.datetime64(began)
        if file != cut:
            assert abs(contents(file).began_ns - run.began_ns) < 10**9


def test_a_recording_of_a_newer_format_is_refused(run, tmp_path, monkeypatch):
    monkeypatch.setattr("rig.record.writer.FORMAT", FORMAT + 1)
    save(run, tmp_path / "run.mcap")
    with pytest.raises(LogError, match=rf"recording of format {FORMAT + 1}, written by a newer version .* install"):
        reader.open(tmp_path / "run.mcap")
    (listed,) = runs(tmp_path)
    assert (listed.contents, listed.fault.partition(",")[0]) == (None, f"is a recording of format {FORMAT + 1}")


def test_a_run_saved_from_python_has_its_provenance(tmp_path):
    made = rig.simulate(rig.load("belt", {"seed": "7"}), 0.05)
    made.save(tmp_path / "run.mcap")
    read = reader.open(tmp_path / "run.mcap").provenance
    assert read == made.provenance
    assert read["seed"] == "7"
    assert read["numpy"] == np.__version__
    assert read["kernel"]
    assert read["date"]


def test_an_unknown_channel_names_those_that_are_like_it(run):
    name = next(iter(run.signals))
    for channels, asked in ((run.signals, name[:-2]), (run.units, name[:-2])):
        with pytest.raises(KeyError, match=f"is not in this run; did you mean {name}"):
            channels[asked]
