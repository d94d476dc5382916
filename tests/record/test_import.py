"""Measurements of any bench become recordings, to the last bit of their files, or are refused with every fault."""

from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy import io as scipy_io

import rig as lab
from rig.errors import UsageError
from rig.record.imports.channel_map import ChannelMap
from rig.record.imports.import_run import import_files, listed
from rig.record.imports.measurement_file import opened
from rig.units import si_unit

T = np.arange(400) / 2000.0
V = np.sin(40.0 * np.pi * T) * np.exp(-T) / 3.0


def frame():
    return pd.DataFrame({"t [s]": T, "v [m/s]": V})


def hdf5(path, **columns):
    with h5py.File(path, "w") as file:
        for name, (values, unit) in columns.items():
            file[name] = values
            file[name].attrs["units"] = unit


def netcdf(path):
    with scipy_io.netcdf_file(path, "w") as file:
        file.createDimension("n", T.size)
        for name, values, unit in (("t", T, "s"), ("v", V, "m/s")):
            file.createVariable(name, "d", ("n",))[:] = values
            file.variables[name].units = unit


def uff(path, binary):
    pyuff = pytest.importorskip("pyuff")
    about = pyuff.prepare_58(
        binary=binary,
        func_type=1,
        rsp_node=1,
        rsp_dir=1,
        ref_dir=1,
        ref_node=1,
        data=V,
        x=T,
        id1="v",
        rsp_ent_name="a",
        ref_ent_name="b",
        abscissa_spacing=1,
        abscissa_spec_data_type=17,
        ordinate_spec_data_type=11,
        orddenom_spec_data_type=0,
        abscissa_inc=T[1],
        abscissa_min=0.0,
        num_pts=T.size,
        ord_data_type=4,
        ordinate_axis_units_lab="m/s",
    )
    pyuff.UFF(str(path)).write_sets([about], "add")


def tdms(path):
    nptdms = pytest.importorskip("nptdms")
    about = {"wf_increment": T[1], "unit_string": "m/s", "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([nptdms.ChannelObject("g", "v", V, properties=about)])


WRITERS = {
    "ascii.uff": lambda path: uff(path, 0),
    "binary.uff": lambda path: uff(path, 1),
    "x.tdms": tdms,
    "x.csv": lambda path: frame().to_csv(path, index=False),
    "x.parquet": lambda path: frame().to_parquet(path),
    "x.mat": lambda path: scipy_io.savemat(path, {"run": {"t": T, "v": V}}),
    "x.h5": lambda path: hdf5(path, t=(T, "s"), v=(V, "m/s")),
    "x.nc": netcdf,
    "x.wav": lambda path: scipy_io.wavfile.write(path, 2000, V),
}


UNCLOSED = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves its file open


@UNCLOSED
@pytest.mark.parametrize("name", WRITERS)
def test_files_of_other_programs_are_read_to_the_last_bit(tmp_path, name):
    path, out = tmp_path / name, tmp_path / "x.mcap"
    WRITERS[name](path)
    columns = {"x.wav": "ch1 = v, 1 m/s", "x.mat": "run.v = v, m/s", "x.tdms": "g.v = v"}
    times = {"x.mat": "run.t, s"} | dict.fromkeys(("x.wav", "ascii.uff", "binary.uff", "x.tdms"), "")
    column, time = columns.get(name, "v = v"), times.get(name, "t")
    import_files([path], out, ChannelMap.of_texts([column], time))
    samples, run = lab.open(out).measurements["v"], lab.open(out)
    assert np.array_equal(samples.v, V if name != "ascii.uff" else [float(f"{v:.11e}") for v in V])
    assert np.array_equal(samples.t_ns, np.rint(T * 1e9))
    assert (run.units["meas/v"], run.measured, run.damage, run.sealed) == ("m/s", True, "", True)


@pytest.mark.parametrize(
    ("text", "columns", "values"),
    [
        ("t [s],v [mm/s]\n0,1.5\n1,2.5\n", {"t": "s", "v": "mm/s"}, [1.5, 2.5]),
        ("Rig 7\nDate;12.3.2024\n\nt [s];v (mm/s)\n0,0;1,5\n0,1;-2,5e-1\n", {"t": "s", "v": "mm/s"}, [1.5, -0.25]),
        ("# t\tv\n# s\tm/s\n0\t1\n1\t2\n", {"t": "s", "v": "m/s"}, [1.0, 2.0]),
        ("  0.0   1e-3\n  0.5   2\n", {"column 1": "", "column 2": ""}, [1e-3, 2.0]),
        ("v,v\n1,2\n3,4\n", {"v": "", "v (2)": ""}, [2.0, 4.0]),
        ('"t; left [s]";"v [N]";\n0;1,5;\n1; nan;\n', {"t; left": "s", "v": "N"}, [1.5, np.nan]),
        ('"t [s]","v [N]",""\n"0,0","1,5"\n"0,1","2,5"\n', {"t": "s", "v": "N"}, [1.5, 2.5]),
        ("t;v\ns;N m\nch0;ch1\n\n0;1;\n1;2;\n", {"t": "s", "v": "N m"}, [1.0, 2.0]),
        ("".join(f"line {i}: {'x' * 90}\n" for i in range(1000)) + "t,v\n0,1\n1,2\n", {"t": "", "v": ""}, [1.0, 2.0]),
        ("t [s],state,v [N]\n0,on,1\n1,off,2\n", {"t": "s", "v": "N"}, [1.0, 2.0]),
        ("when,v\n2024-01-01 10:00:00.000,1\n2024-01-01 10:00:00.001,2\n", {"when": "s", "v": ""}, [1.0, 2.0]),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_the_form_of_a_text_is_found(tmp_path, text, columns, values, encoding):
    path = tmp_path / "x.csv"
    path.write_bytes(text.replace("v", "ä").encode(encoding))
    file = opened(path)
    assert {c.name.replace("ä", "v"): c.unit for c in file.columns} == columns
    name = file.columns[-1].name
    assert np.array_equal(np.concatenate([block[name] for block in file.blocks([name])]), values, equal_nan=True)


@pytest.mark.parametrize(
    ("form", "began"),
    [
        ("10:00:00.{}", None),
        ("2024-03-01 10:00:00,{}", 1709287200),
        ("2024-03-01T10:00:00.{}Z", 1709287200),
        ("2024-03-01 10:00:00.{}+01:00", 1709283600),
        ("01.03.2024 10:00:00.{}", 1709287200),
    ],
)
def test_times_of_day_become_seconds(tmp_path, form, began):
    path = tmp_path / "x.csv"
    path.write_text("time;v\n" + "".join(f"{form.format(ms)};1\n" for ms in ("000", "0015", "004000001")))
    file = opened(path)
    (block,) = file.blocks(["time"])
    assert block["time"].tolist() == [0.0, 0.0015, 0.004000001]
    assert file.began_ns == (began and began * 1_000_000_000)


def matlab_73(path, **values):
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in values.items():
            file[f"run/{name}"] = value
        file["run/name"] = np.array([[97], [98]], np.uint16)
        file["run/name"].attrs["MATLAB_class"] = np.bytes_("char")
        file["run/none"] = np.zeros(2, np.uint64)
        file["run/none"].attrs["MATLAB_empty"] = np.uint8(1)
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])


def packed(path):
    with h5py.File(path, "w") as file:
        file["v"] = np.array([1, -9, 3], np.int16)
        file["v"].attrs.update({"units": np.array(["N"], object), "scale_factor": 0.5, "add_offset": 1.0})
        file["v"].attrs["_FillValue"] = np.int16(-9)


def cells(path):
    about = np.empty(2, object)
    about[:] = [{"v": V, "unit": "N"}, {"v": T}]
    scipy_io.savemat(path, {"ch": about})


@pytest.mark.parametrize(
    ("name", "write", "columns"),
    [
        ("x.mat", lambda path: matlab_73(path, v=V[None, :]), {"run.v": ("", V)}),
        ("x.mat", cells, {"ch.1.v": ("", V), "ch.2.v": ("", T)}),
        ("x.nc", packed, {"v": ("N", [1.5, np.nan, 2.5])}),
        (
            "x.parquet",
            lambda path: pd.DataFrame({"d": pd.to_timedelta(T, unit="s")}).to_parquet(path),
            {"d": ("s", np.rint(T * 1e9) * 1e-9)},
        ),
    ],
)
def test_what_formats_keep_beside_plain_vectors(tmp_path, name, write, columns):
    write(tmp_path / name)
    file = opened(tmp_path / name)
    (block,) = file.blocks([column.name for column in file.columns])
    assert {c.name: c.unit for c in file.columns} == {name: unit for name, (unit, _) in columns.items()}
    for name, (_, values) in columns.items():
        assert np.array_equal(block[name], values, equal_nan=True)


@pytest.mark.parametrize(
    ("text", "given", "unit", "value"),
    [
        ("ch1 [V]", "ch1 = a, 125 mm/s/V", "m/s", 0.25),
        ("ch1 [mV]", "ch1 = a, 125 mm/s/V", "m/s", 0.25e-3),
        ("ch1", "ch1 = a, 100 N/V, offset -2.5 N", "N", 197.5),
        ("T [degC]", "T = a", "K", 275.15),
        ("n [rpm]", "n = a", "rad/s", 2.0 * np.pi / 30.0),
        ("p", "p = a, bar", "Pa", 2e5),
        ("q", "q = a, 3", "1", 6.0),
    ],
)
def test_a_column_becomes_a_channel_in_si(tmp_path, text, given, unit, value):
    path = tmp_path / "x.csv"
    path.write_text(f"{text}\n2\n2\n")
    import_files([path], tmp_path / "x.mcap", ChannelMap.of_texts([given], rate="1 kHz"))
    run = lab.open(tmp_path / "x.mcap")
    assert run.units["meas/a"] == unit == si_unit(unit)
    assert run.measurements["a"].v == pytest.approx([value] * 2, rel=1e-15)


GOOD = "t [s],v [m/s],w\n"
FAULTS = [
    (
        GOOD + "0,1,1\n1,2\n2,x,3\n3;4;5\n4,1,1\n5,6",
        {},
        [
            "row 3: 2 values, the other rows have 3",
            "row 4, column v: 'x' is not a number",
            "row 5: 1 value, the other rows have 3; with ';'",
            "row 7: 2 values",
            "the file ends in the middle of it",
        ],
    ),
    (
        GOOD + "0,1,1\n1,2,2\n1,3,3\n0.5,4,4\n2,1,1\n",
        {},
        ["row 4, column t: the time 1 s is that of the row before", "row 5, column t: the time 0.5 s falls", "--rate"],
    ),
    (
        GOOD + "0,1,1\n1,1,1\n",
        {"texts": ["w = a", "x = b", "v = c, 0 N/V"]},
        ["states no unit for w", "there is no column 'x'", "a scale of 0 leaves nothing"],
    ),
]


@pytest.mark.parametrize(("text", "given", "told"), FAULTS)
def test_a_faulty_measurement_is_refused_with_every_fault_and_nothing_is_written(tmp_path, text, given, told):
    path, out = tmp_path / "x.csv", tmp_path / "x.mcap"
    path.write_text(text)
    out.write_text("kept")
    mapped = ChannelMap.of_texts(given.get("texts", ["v = v"]), given.get("time", "t"))
    with pytest.raises(UsageError) as caught:
        import_files([path], out, mapped, replace=True)
    assert all(part in str(caught.value) for part in told), str(caught.value)
    assert str(path) in str(caught.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["x.csv", "x.mcap"]
    assert out.read_text() == "kept"


def test_a_complex_data_set_is_no_measurement_over_time(tmp_path):
    path = tmp_path / "x.mat"
    scipy_io.savemat(path, {"t": T, "H": V + 1j * V})
    assert "H  not read: it is complex" in listed([path]).text()
    with pytest.raises(UsageError, match=r"x\.mat: column H is not read: it is complex"):
        import_files([path], tmp_path / "x.mcap", ChannelMap.of_texts(["H = h, 1 m"], "t, s"))


@UNCLOSED
@pytest.mark.parametrize("name", ["x.parquet", "x.mat", "x.h5", "x.nc", "x.wav", "ascii.uff", "binary.uff", "x.tdms"])
def test_a_truncated_file_is_refused(tmp_path, name):
    path = tmp_path / name
    WRITERS[name](path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(UsageError, match=rf"{name}: .*cut off"):
        opened(path)


def test_missing_values_gaps_and_drift_are_told(tmp_path):
    t = np.cumsum(1e-3 * (1.0 + 1e-4 * np.arange(3000) / 3000.0))  # the period grows by 100 ppm
    t[2000:] += 0.5
    table = pd.DataFrame({"t [s]": t, "v [m/s]": np.sin(t)})
    table.loc[5, "v [m/s]"] = np.nan
    table.to_csv(tmp_path / "x.csv", index=False)
    made = import_files(
        [tmp_path / "x.csv"], tmp_path / "x.mcap", ChannelMap.of_texts(["v = v"], "t"), skip_missing=True
    )
    assert "1 gap, the longest 0.501 s" in made.text()
    assert made.bases[0].drift == pytest.approx(0.75e-4, rel=0.02)  # between the middles of the outer quarters
    assert "the period drifts by" in made.text()
    assert "1 missing value left out" in made.text()
    assert lab.open(tmp_path / "x.mcap").measurements["v"].v.size == 2999


@pytest.mark.parametrize("join", ["pulse > 2.5 V", "pulse"])
def test_two_files_of_one_run_get_a_common_time(tmp_path, join):
    """The second system starts 0.1234 s later, at another rate; both have recorded the pulse."""

    def pulse(t):
        return 5.0 / (1.0 + np.exp(-(t - 0.6) / 2e-3)) - 5.0 / (1.0 + np.exp(-(t - 0.8) / 2e-3))

    a, b = np.arange(0.0, 1.5, 1e-3), np.arange(0.1234, 1.3, 0.4e-3)
    pd.DataFrame({"t [s]": a, "pulse [V]": pulse(a), "v [m/s]": np.sin(a)}).to_csv(tmp_path / "a.csv", index=False)
    pd.DataFrame({"t [s]": b - b[0], "pulse [V]": pulse(b), "w [m/s]": np.sin(b)}).to_csv(
        tmp_path / "b.csv", index=False
    )
    mapped = ChannelMap.of_texts(["pulse = pulse", "v = v", "w = w"], "t")
    import_files([tmp_path / "a.csv", tmp_path / "b.csv"], tmp_path / "x.mcap", mapped, join)
    run = lab.open(tmp_path / "x.mcap")
    assert set(run.measurements) == {"pulse", "v", "w"}
    t_ns, w = run.measurements["w"]
    assert w == pytest.approx(np.sin(t_ns * 1e-9), abs=1e-4)


def test_without_a_common_time_several_files_are_refused(tmp_path):
    for name in "ab":
        frame().to_csv(tmp_path / f"{name}.csv", index=False)
    paths, mapped = [tmp_path / "a.csv", tmp_path / "b.csv"], ChannelMap.of_texts(["v = v"], "t")
    with pytest.raises(UsageError, match="need a common time"):
        import_files(paths, tmp_path / "x.mcap", mapped)
    with pytest.raises(UsageError, match=r"never met in .*a\.csv"):
        import_files(paths, tmp_path / "x.mcap", mapped, "v > 9 m/s")


def test_the_columns_are_listed_and_a_map_is_proposed_that_never_guesses_a_unit(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("t [ms],Vel. 1 [mm/s],ch2\n0,1,2\n1,2,3\n2,3,1\n")
    found = listed([path])
    assert found.proposal == ChannelMap({"Vel. 1": "vel_1, mm/s", "ch2": "ch2, ?"}, "t, ms", "")
    assert "1 .. 3 mm/s, 3 values" in found.text()
    (tmp_path / "import.toml").write_text(found.proposal.text().replace("?", "10 N/V"))
    assert ChannelMap.read(tmp_path / "import.toml").channels["ch2"] == "ch2, 10 N/V"


def test_the_command_imports_with_the_map_beside_the_files_and_what_works_on_a_recording_works(tmp_path, rig):
    """A sweep of a vibration, with the speed of its drive."""
    t = np.arange(0.0, 8.0, 0.25e-3)
    v, n = np.sin(2.0 * np.pi * (5.0 + t) * t), np.minimum(t, 8.0 - t)
    pd.DataFrame({"t [s]": t, "v [mm/s]": v, "x [mm]": np.cumsum(v) * 1e-3, "n [rad/s]": n}).to_csv(
        tmp_path / "x.csv", index=False
    )
    (tmp_path / "import.toml").write_text('time = "t"\n[channels]\nv = "vel"\nx = "pos"\nn = "speed"\n')
    log = tmp_path / "x.mcap"
    assert rig("import", tmp_path / "x.csv")[0] == 0
    assert rig("import", tmp_path / "x.csv")[0] == 2  # there already
    code, out, _ = rig("runs", tmp_path)
    assert (code, "measured" in out) == (0, True)
    for command in (
        ("analyse", "spectrum", log),
        ("analyse", "hysteresis", log, "--over", "speed"),
        ("analyse", "portrait", log, "--x", "pos", "--y", "vel"),
        ("analyse", "response", log, "--input", "vel", "--output", "pos"),
        ("analyse", "amplitude", log),
        ("analyse", "sound", log, "--signal", "vel"),
        ("diff", log, log),
        ("export", log, "--to", "csv", "--out", tmp_path / "out"),
        ("note", log, "hot day"),
        ("report", log, "--out", tmp_path / "x.html"),
        ("view", log, "--save", tmp_path / "x.rrd"),
    ):
        code, out, err = rig(*command)
        assert (code, err) == (0, ""), (command, out, err)
    code, out, _ = rig("verify", log)
    assert (code, "a measurement of 8 s, 3 channels" in out) == (0, True)
    assert "Measured" in (tmp_path / "x.html").read_text()
    for command in (("simulate", "--from", log), ("explain", log)):
        code, _, err = rig(*command)
        assert (code, "it is a measurement: it contains no rig" in err) == (2, True), (command, err)


PAPER = Path(__file__).parents[2] / "recordings" / "stick_slip_paper"


@pytest.mark.parametrize("path", sorted(PAPER.glob("*.mat")), ids=lambda path: path.stem)
def test_the_shipped_measurements_are_proposed_as_their_map_has_them(path):
    mapped = ChannelMap.read(PAPER / "import.toml")
    proposal = listed([path]).proposal
    assert proposal.channels.keys() == mapped.channels.keys()
    assert proposal.time.replace("?", "s") == mapped.time


def test_channels_of_a_tdms_that_start_one_after_the_other(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "x.tdms") as writer:
        for i, name in enumerate("ab"):
            about = {
                "wf_increment": 1e-3,
                "unit_string": "N",
                "wf_start_time": np.datetime64(1709287200000 + 250 * i, "ms"),
            }
            writer.write_segment([nptdms.ChannelObject("g", name, V, properties=about)])
    assert [column.start for column in opened(tmp_path / "x.tdms").columns] == [0.0, 0.25]
    assert "400 values at 1000 Hz" in listed([tmp_path / "x.tdms"]).text()


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.wav", b"RIFF", "expected a .wav file"),
        ("a.csv", b"", "it is empty; expected rows of numbers"),
        ("a.csv", b"\n\n", "it is empty; expected rows of numbers"),
    ],
)
def test_a_file_without_content_is_told_in_words(rig, tmp_path, name, content, told):
    (tmp_path / name).write_bytes(content)
    code, _, err = rig("import", tmp_path / name)
    assert (code, told in err, name in err) == (2, True, True)


def test_a_column_without_values_is_told_in_words(rig, tmp_path):
    (tmp_path / "a.csv").write_text("t,a\n0,nan\n1,nan\n2,nan\n")
    code, out, _ = rig("import", tmp_path / "a.csv")
    assert (code, "a  no values, (no unit stated), 0 values" in out, "inf" in out) == (0, True, False)
