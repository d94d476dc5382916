"""Files of many kinds, made from known signals: they become recordings to the last digit, or are refused."""

import os

import h5py
import numpy as np
import pytest
from measurement_kinds import Kind, N, T, V, check, comma, lines, rows, uff
from scipy import io as scipy_io

import rig as lab
from rig.errors import UsageError
from rig.record.imports.channel_map import ChannelMap
from rig.record.imports.import_run import import_files, listed

LATE = np.arange(9000) / 1000.0


def german(x, digits=3):
    """1.234,500"""
    return f"{x:,.{digits}f}".translate(str.maketrans(",.", ".,"))


def clock(t, form, date="03/01/2024"):
    """The time of day at t [s] after 10:00:00."""
    return form.format(date=date, clock=f"10:00:{t:09.6f}")


def matlab_73(path, **kinds):
    """A file of MATLAB 7.3 with a struct array `run` (fields t and v) and a cell `c`."""
    with h5py.File(path, "w", userblock_size=512) as file:
        run = file.create_group("run")
        for key, values in kinds.items():
            references = []
            for i, value in enumerate(values):
                file[f"#refs#/{key}{i}"] = np.asarray(value)[None, :]
                references.append(file[f"#refs#/{key}{i}"].ref)
            where = file if key == "c" else run
            where.create_dataset(key, data=np.array([references], h5py.ref_dtype))
            where[key].attrs["MATLAB_class"] = np.bytes_("cell" if key == "c" else "double")
            if key != "c":
                del where[key].attrs["MATLAB_class"]
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])


def hdf5(path, **columns):
    with h5py.File(path, "w") as file:
        for name, (values, unit) in columns.items():
            file[name] = values
            if unit:
                file[name].attrs["units"] = unit


def compound(path):
    table = np.zeros(T.size, [("t", "f8"), ("v", "f8"), ("note", "S4")])
    table["t"], table["v"] = T, V
    with h5py.File(path, "w") as file:
        file["table"] = table
        file["table"].attrs.update({"FIELD_0_UNITS": "s", "FIELD_1_UNITS": "m/s"})


def external(path):
    (path.parent / "secret.bin").write_bytes(V.tobytes())
    with h5py.File(path, "w") as file:
        file.create_dataset("v", V.shape, "f8", external=[(str(path.parent / "secret.bin"), 0, h5py.h5f.UNLIMITED)])
        file["t"] = T


def linked(path):
    hdf5(path.parent / "other.h5", v=(V, "m/s"))
    with h5py.File(path, "w") as file:
        file["v"] = h5py.ExternalLink("other.h5", "v")
        file["t"] = T
        file["loop"] = file["/"]


def virtual(path):
    hdf5(path.parent / "other.h5", v=(V, "m/s"))
    layout = h5py.VirtualLayout(V.shape, "f8")
    layout[:] = h5py.VirtualSource(path.parent / "other.h5", "v", V.shape)
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("v", layout)
        file["t"] = T


def netcdf(path, t, unit="s"):
    with scipy_io.netcdf_file(path, "w") as file:
        file.createDimension("n", T.size)
        for name, values, unit_of in (("t", t, unit), ("v", V, "m/s")):
            file.createVariable(name, "d", ("n",))[:] = values
            file.variables[name].units = unit_of


def with_gap(values, *places):
    values = np.array(values, float)
    values[list(places)] = np.nan
    return values


def zero_factor(path):
    hdf5(path, t=(T, "s"), v=(V, "m/s"))
    with h5py.File(path, "a") as file:
        file["v"].attrs["scale_factor"] = 0.0


def times_without_a_date(path):
    import pyarrow as pa
    from pyarrow import parquet

    times = pa.array([1_000_000, 1_500_000, 2_000_000], pa.time64("us"))
    parquet.write_table(pa.table({"t": times, "v [m/s]": [1.0, 2.0, 3.0]}), path)


def parquet_with_units(path):
    """The unit of one column in its field, of the others in the metadata of the table."""
    import pyarrow as pa
    from pyarrow import parquet

    fields = [pa.field("t", pa.float64()), pa.field("v", pa.float64(), metadata={"Units": "m/s"})]
    schema = pa.schema(fields, metadata={"units": '{"t": "s"}'})
    parquet.write_table(pa.table([T, V], schema=schema), path)


def hdf5_with(key, unit):
    def write(path):
        with h5py.File(path, "w") as file:
            for name, values, of_column in (("t", T, "s"), ("v", V, unit)):
                file[name] = values
                file[name].attrs[key] = of_column

    return write


def tdms(path, unit):
    nptdms = pytest.importorskip("nptdms")
    about = {"wf_increment": T[1], "unit_string": unit, "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(path) as writer:
        words = nptdms.ChannelObject("g", "state", ["on"] * 3)
        writer.write_segment([nptdms.ChannelObject("g", "v", V, properties=about), words])


def damaged_parquet(path):
    from pyarrow import parquet, table

    noise = np.random.default_rng(1).normal(size=20_000)
    made = table({"t [s]": np.arange(noise.size) / 1000.0, "v [m/s]": noise})
    parquet.write_table(made, path, row_group_size=5000, write_page_checksum=True)
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 2000] = b"\x55" * 2000
    path.write_bytes(data)


def parquet_with_words(path):
    from decimal import Decimal

    import pyarrow as pa
    from pyarrow import parquet

    times = pa.array([None, *(round(1e6 * t) for t in T[1:])], pa.timestamp("us"))
    v = pa.array([Decimal(f"{v:.6f}") for v in V], pa.decimal128(12, 6))
    parquet.write_table(pa.table({"t": times, "v [m/s]": v, "state": ["on"] * T.size}), path)


LVM = [
    "LabVIEW Measurement\t",
    "Writer_Version\t2",
    "Separator\tTab",
    "Decimal_Separator\t,",
    "Multi_Headings\tNo",
    "X_Columns\t{columns}",
    "Date\t2024/03/01",
    "Time\t10:00:00,5000000000000000000",
    "***End_of_Header***\t",
    "\t",
    "Channels\t2\t\t",
    "Samples\t200\t200\t",
    "Y_Unit_Label\tm/s\trpm\t",
    "X_Dimension\tTime\tTime\t",
    "X0\t0,0\t0,0\t",
    "Delta_X\t0,001\t0,001\t",
    "***End_of_Header***\t\t\t",
    "X_Value\tv\tn\tComment",
]
SPEED = ("rad/s", N * 2.0 * np.pi / 60.0)
KINDS = {
    "decimal comma beside words.csv": Kind(
        lines("t [s];state;v [m/s];k", *rows(lambda t, v, n: f"{comma(t)};on;{comma(v)};7")),
        left_out={"state": "it has words, no numbers, such as 'on'"},
    ),
    "decimal comma beside dates.csv": Kind(
        lines("t [s];day;v [m/s]", *rows(lambda t, v, n: f"{comma(t)};01.03.2024;{comma(v)}")),
        left_out={"day": "it has dates without a time of day"},
    ),
    "decimal comma beside times and words.csv": Kind(
        lines("t;v [m/s];s", *rows(lambda t, v, n: f"01.03.2024 10:00:{comma(t).zfill(9)};{comma(v)};ok"))
    ),
    "thousands with a point.csv": Kind(
        lines("t [s];n [U/min];v [m/s]", *rows(lambda t, v, n: f"{comma(t)};{german(n)};{comma(v)}")),
        ["v = v", "n = n"],
        becomes={"v": ("m/s", V), "n": SPEED},
    ),
    "thousands with a point at the end.csv": Kind(
        lines("t [s];n [N]", *(f"{comma(t)};{german(1100.0 * t / LATE[-1])}" for t in LATE)),
        ["n = n"],
        becomes={"n": ("N", np.round(1100.0 * LATE / LATE[-1], 3))},
        t=LATE,
    ),
    "thousands without decimals.csv": Kind(
        lines("t [s];n [U/min];v [m/s]", *rows(lambda t, v, n: f"{comma(t)};1.{n:03.0f};{comma(v)}")[:60]),
        becomes={"v": ("m/s", V[:60])},
        t=T[:60],
        left_out={"n": "1.000 may be 1000 or 1,0000; write it as one of these"},
    ),
    "thousands in quotes.csv": Kind(
        lines("t [s],n [rpm],v [m/s]", *rows(lambda t, v, n: f'{t:.6f},"{n:,.3f}",{v}')),
        ["v = v", "n = n"],
        becomes={"v": ("m/s", V), "n": SPEED},
    ),
    "thousands with an apostrophe.txt": Kind(
        lines("t [s]\tn [min-1]\tv [m/s]", *rows(lambda t, v, n: f"{t:.6f}\t{n:,.3f}\t{v}".replace(",", "'"))),
        ["v = v", "n = n"],
        becomes={"v": ("m/s", V), "n": SPEED},
    ),
    "slashes and AM.csv": Kind(
        lines("t,v [m/s]", *rows(lambda t, v, n: f"{clock(t, '{date} {clock} AM')},{v}")),
    ),
    "afternoon across noon.csv": Kind(
        lines("t,v [m/s]", "3/1/2024 11:59:59.500 AM,1", "3/1/2024 12:00:00.000 PM,2", "3/1/2024 1:00:00.000 PM,3"),
        becomes={"v": ("m/s", [1.0, 2.0, 3.0])},
        t=[0.0, 0.5, 3600.5],
    ),
    "two digits of the year.csv": Kind(
        lines("t;v [m/s]", *rows(lambda t, v, n: f"{clock(t, '{date} {clock}', '01.03.24')};{v}")),
    ),
    "two digits of the year with slashes.csv": Kind(
        lines("t;v [m/s]", *rows(lambda t, v, n: f"{clock(t, '{date} {clock}', '31/12/24')};{v}")),
    ),
    "day first over the end of a month.csv": Kind(
        lines("t;v [m/s]", "31/01/2024 23:59:59;1", "01/02/2024 00:00:00;2", "01/02/2024 00:00:01;3"),
        becomes={"v": ("m/s", [1.0, 2.0, 3.0])},
        t=[0.0, 1.0, 2.0],
    ),
    "slashes of an open order, one day.csv": Kind(
        lines("t;v [m/s]", *rows(lambda t, v, n: f"{clock(t, '{date} {clock}')};{v}")),
    ),
    "slashes of an open order, two days.csv": Kind(
        lines("t;v [m/s]", "03/04/2024 23:59:59;1", "04/04/2024 00:00:00;2"),
        refused=("row 3, column t", "may have the day or the month first; write dates as 2024-01-31"),
    ),
    "months by name.csv": Kind(
        lines("t,v [m/s]", *rows(lambda t, v, n: f"{clock(t, '{date} {clock}', '01-Mar-2024')},{v}")),
    ),
    "dates beside times, by blanks.txt": Kind(
        lines("day t v", *rows(lambda t, v, n: f"2024-03-01 {clock(t, '{clock}')} {v}")),
        ["v = v, m/s"],
        left_out={"day": "it has dates without a time of day"},
    ),
    "remarks beside the first rows.csv": Kind(
        lines(
            "t [s],v [m/s],,",
            *rows(lambda t, v, n: f"{t:.6f},{v},{'operator,Smith' if t < 0.015 else ','}"),
        ),
    ),
    "more cells in the first rows.csv": Kind(
        lines("t [s],v [m/s]", *rows(lambda t, v, n: f"{t:.6f},{v}{',,rate,1000' if t < 0.015 else ''}")),
        left_out={"beside the rows": "remarks behind the values of the first 15 rows"},
    ),
    "lines of numbers above the rows.csv": Kind(
        lines("7,8,9,10", "11,12,13", *rows(lambda t, v, n: f"{t:.6f},{v}")),
        ["column 2 = v, m/s"],
        "column 1, s",
        left_out={"above the rows": "2 lines with a number first, but not as many cells"},
    ),
    "thousands without decimals beside small numbers.csv": Kind(
        lines("t [s];n [U/min];v [m/s]", *rows(lambda t, v, n: f"{t:.6f};{german(n, 0)};{v}")),
        left_out={"n": "1.010 may be 1010 or 1.0100; write it as one of these"},
    ),
    "remarks before the first rows.csv": Kind(
        lines(*rows(lambda t, v, n: f"{'Interval,0.001' if t < 0.015 else ','},,{t:.6f},{v}")),
        ["column 5 = v, m/s"],
        "column 4, s",
    ),
    "a word in the first row.csv": Kind(
        lines("t [s],v [m/s],w", "0,overload,1", *(f"{t},{t},2" for t in range(1, 30))),
        refused=("row 2, column v: 'overload' is not a number",),
    ),
    "no time in a row.csv": Kind(
        lines("t [s],v [m/s]", "0,1", ",2", "2,3", "nan,4", "4,5"),
        refused=("row 3 (and 5), column t: there is no time", "--skip-missing", "--rate RATE"),
    ),
    "no time at both ends.csv": Kind(
        lines("t [s],v [m/s]", ",1", "0,2", "1,3", ",4"),
        refused=("row 2 (and 5), column t: there is no time",),
    ),
    "no time at both ends, left out.csv": Kind(
        lines("t [s],v [m/s]", ",1", "0,2", "1,3", "2,", "3,5", "nan,4"),
        skip=True,
        becomes={"v": ("m/s", [2.0, 3.0, 5.0])},
        t=[0.0, 1.0, 3.0],
    ),
    "no time of day in a row, left out.csv": Kind(
        lines("t,v [m/s]", ",1", "10:00:00.5 AM,2", ",3", "10:00:01.5 AM,4"),
        skip=True,
        becomes={"v": ("m/s", [2.0, 4.0])},
        t=[0.0, 1.0],
    ),
    "other words for no value.csv": Kind(
        lines("t [s];v [m/s]", "0;1", "1;1.#QNAN", "2;#N/A", "3;---", "4;NULL", "5;2"),
        skip=True,
        becomes={"v": ("m/s", [1.0, 2.0])},
        t=[0.0, 5.0],
    ),
    "two segments.lvm": Kind(
        lines(
            *(line.format(columns="One") for line in LVM),
            *rows(lambda t, v, n: f"{comma(t)}\t{comma(v)}\t{comma(n, 3)}\t"),
            *(line.format(columns="One") for line in LVM[9:]),
            *rows(lambda t, v, n: f"{comma(t)}\t{comma(v)}\t{comma(n, 3)}\t"),
        ),
        time="X_Value",
        refused=("row 220: another segment of LabVIEW begins here", "save each segment as a file of its own"),
        in_one_line=True,
    ),
    "a cut UTF-16.csv": Kind(
        lambda path: path.write_bytes("t [s],v [m/s]\n0,1\n1,2\n2,3\n".encode("utf-16")[:-3]),
        refused=("is cut off",),
    ),
    "UTF-16 without a mark.csv": Kind(
        lines("t [s],v [m/s]", *rows(lambda t, v, n: f"{t:.6f},{v}"), encoding="utf-16-le"),
    ),
    "a line of Windows characters.csv": Kind(
        lines("Pr\xfcfstand\x85 7", "t [s],v [m/s]", *rows(lambda t, v, n: f"{t:.6f},{v}"), encoding="latin-1"),
    ),
    "times beyond the clock.csv": Kind(
        lines("t,v [m/s]", "1709287200000,1", "1709287200001,2"),
        time="t, s",
        refused=("row 2 (and 3), column t: the time 1.7092872e+12 s lies beyond 1e+11 s; state its unit",),
    ),
    "times of an epoch in ms.csv": Kind(
        lines("t,v [m/s]", "1709287200000,1", "1709287200500,2"),
        time="t, ms",
        becomes={"v": ("m/s", [1.0, 2.0])},
        t=[0.0, 0.5],
    ),
    "too large for a double.csv": Kind(
        lines("t [s],v [V]", "0,1", "1,1e308", "2,1"),
        ["v = v, 10 m/s/V"],
        refused=("row 3, column v: too large for a double in m/s",),
    ),
    "the largest doubles.csv": Kind(
        lines("t [s],v [m/s]", "0,1e308", "1,-1e308", "2,1"), becomes={"v": ("m/s", [1e308, -1e308, 1.0])}, t=[0, 1, 2]
    ),
    "Keysight.csv": Kind(
        lines("x-axis,1,2", "second,Volt,Volt", *rows(lambda t, v, n: f"{t:+.8E},{v:+.8E},{n:+.8E}")),
        ["1 = v, 1 m/s/V", "2 = n, 1 rpm/V"],
        "x-axis",
        becomes={"v": ("m/s", V), "n": SPEED},
    ),
    "Keysight, increments.csv": Kind(
        lines(
            "Type:,raw", "Points:,200", "XInc:,0.001", "XOrg:,-0.1", "YUnits:,Volt", "Data:", *rows(lambda t, v, n: v)
        ),
        ["Data = v, 1 m/s/V"],
        "",
    ),
    "catman.txt": Kind(
        lines(
            "File:\tC:\\bench.tst",
            "Operator:\tSmith",
            "",
            "Time  1 - default sample rate [s]\tSpeed [1/min]\tVibrometer [m/s]",
            "\tMX840A CH 1\tMX840A CH 2",
            "\tT40B\tOFV 505",
            "SR 1000\t\t",
            *rows(lambda t, v, n: f"{comma(t)}\t{comma(n, 3)}\t{comma(v)}"),
            encoding="latin-1",
        ),
        ["Speed = n", "Vibrometer = v"],
        "Time  1 - default sample rate",
        becomes={"n": SPEED, "v": ("m/s", V)},
    ),
    "catman, a line of units.txt": Kind(
        lines(
            "CH\tTime\tSpeed\tVibrometer",
            "Time\tn\tv",
            "s\t1/min\tm/s",
            *rows(lambda t, v, n: f"{comma(t)}\t{comma(n, 3)}\t{comma(v)}"),
        ),
        ["n = n", "v = v"],
        "Time",
        becomes={"n": SPEED, "v": ("m/s", V)},
    ),
    "LabVIEW.lvm": Kind(
        lines(
            *(line.format(columns="One") for line in LVM),
            *rows(lambda t, v, n: f"{comma(t)}\t{comma(v)}\t{comma(n, 3)}\t"),
        ),
        ["v = v", "n = n"],
        "X_Value",
        becomes={"v": ("m/s", V), "n": SPEED},
    ),
    "LabVIEW without times.lvm": Kind(
        lines(*(line.format(columns="No") for line in LVM), *rows(lambda t, v, n: f"\t{comma(v)}\t{comma(n, 3)}")),
        ["v = v", "n = n"],
        "",
        becomes={"v": ("m/s", V), "n": SPEED},
    ),
    "20,000 columns.csv": Kind(
        lines(
            ",".join(["t [s]", *(f"c{i} [m/s]" for i in range(20_000))]),
            *(",".join(["0." + str(i)] * 20_001) for i in range(4)),
        ),
        ["c19999 = v"],
        becomes={"v": ("m/s", [0.0, 0.1, 0.2, 0.3])},
        t=[0.0, 0.1, 0.2, 0.3],
    ),
    "three dimensions.mat": Kind(
        lambda path: scipy_io.savemat(path, {"t": T, "v": V, "x": np.ones((2, 3, 4)), "H": V + 1j * V, "k": 1.0}),
        ["v = v, m/s"],
        "t, s",
        left_out={
            "x": "it has 3 dimensions",
            "H": "it is complex: a spectrum or a transfer function",
            "k": "it is a single value",
        },
    ),
    "a pipe.csv": Kind(lambda path: os.mkfifo(path), refused=("is no file, but a directory, a pipe or a device",)),
    "a directory.csv": Kind(lambda path: path.mkdir(), refused=("is no file, but a directory",)),
    "a damaged block.parquet": Kind(damaged_parquet, refused=("is cut off or damaged",)),
    "words, decimals and times.parquet": Kind(
        parquet_with_words,
        skip=True,
        becomes={"v": ("m/s", V[1:])},
        t=T[1:] - T[1],
        left_out={"state": "it has the type"},
    ),
    "external storage.h5": Kind(
        external, ["v = v, m/s"], "t, s", refused=("column v is not read: its values lie in another file",)
    ),
    "an external link.h5": Kind(
        linked,
        ["v = v, m/s"],
        "t, s",
        refused=("column v is not read: it lies in another file, other.h5",),
    ),
    "a virtual data set.h5": Kind(virtual, ["v = v, m/s"], "t, s", refused=("its values lie in another file",)),
    "a compound table.h5": Kind(
        compound, ["table.v = v"], "table.t", left_out={"table.note": "it has words, no numbers"}
    ),
    "structs of MATLAB.mat": Kind(
        lambda path: matlab_73(path, t=[T, T], v=[V, 2.0 * V]),
        ["run.2.v = v, m/s"],
        "run.2.t, s",
        becomes={"v": ("m/s", 2.0 * V)},
    ),
    "cells of MATLAB.mat": Kind(lambda path: matlab_73(path, c=[T, V]), ["c.2 = v, m/s"], "c.1, s"),
    "no time in MATLAB.mat": Kind(
        lambda path: scipy_io.savemat(path, {"t": with_gap(T, 0, 7, 199), "v": V}),
        ["v = v, m/s"],
        "t, s",
        refused=("row 1 (and 8, 200), column t: there is no time",),
    ),
    "no time in MATLAB, left out.mat": Kind(
        lambda path: scipy_io.savemat(path, {"t": with_gap(T, 0, 7, 199), "v": V}),
        ["v = v, m/s"],
        "t, s",
        skip=True,
        becomes={"v": ("m/s", np.delete(V, [0, 7, 199]))},
        t=np.delete(T, [0, 7, 199]) - T[1],
    ),
    "other lengths.mat": Kind(
        lambda path: scipy_io.savemat(path, {"t": T[:-1], "v": V}),
        ["v = v, m/s"],
        "t, s",
        refused=("v has 200 values, t has 199: it is not the time of this column",),
    ),
    "no time in netCDF.nc": Kind(
        lambda path: netcdf(path, with_gap(T, 7)), refused=("row 8, column t: there is no time",)
    ),
    "seconds since a date.nc": Kind(lambda path: netcdf(path, T, "seconds since 2024-03-01 10:00:00")),
    "no time in HDF5.h5": Kind(
        lambda path: hdf5(path, t=(with_gap(T, 199), "s"), v=(V, "m/s")),
        refused=("row 200, column t: there is no time",),
    ),
    "a scale factor of 0.h5": Kind(
        zero_factor, ["v = v, m"], "t, s", refused=("column v is not read: its scale_factor is 0",)
    ),
    "times without a date.parquet": Kind(
        times_without_a_date, becomes={"v": ("m/s", [1.0, 2.0, 3.0])}, t=[0.0, 0.5, 1.0]
    ),
    "a day that no month has.csv": Kind(
        lines("t,v [m/s]", "32.01.2024 10:00:00,1", "01.02.2024 10:00:01,2", "01.02.2024 10:61:00,3"),
        refused=("row 2 (and 4), column t: '32.01.2024 10:00:00' is not a time of day",),
    ),
    "minutes and seconds.csv": Kind(
        lines("t,v [m/s]", "00:00,1", "00:01,2", "00:02,3"),
        refused=("row 2 (and 3, 4), column t: '00:00' may be hours and minutes or minutes and seconds",),
        in_one_line=True,
    ),
    "hours and minutes beside a date.csv": Kind(
        lines("Date,Time,v [m/s]", "2024-03-01,10:00,1", "2024-03-01,10:01,2"),
        time="Time",
        becomes={"v": ("m/s", [1.0, 2.0])},
        t=[0.0, 60.0],
    ),
    "infinite.csv": Kind(
        lines("t [s],v [m/s]", "0,1", "", "1,1e400", "2,inf"),
        refused=("row 4 (and 5), column v: the value is infinite",),
    ),
    "quotes that do not end.csv": Kind(
        lines("t [s],v [m/s]", '0,"1', "1,2", "2,3"), refused=("row 2: its quotes do not end",)
    ),
    "the end of time.csv": Kind(
        lines("t [s],v [m/s]", "-1e300,1", "1e300,2"),
        refused=("row 2 (and 3), column t: the time -1e+300 s lies beyond",),
    ),
    "g by its label.uff": Kind(
        lambda path: uff(path, "g"),
        ["v = a"],
        "",
        refused=("the unit that the file states, 'g' has two meanings", '"v = a, g_n"', '"v = a, gram"'),
    ),
    "an unknown unit.tdms": Kind(
        lambda path: tdms(path, "EU"),
        ["g.v = v"],
        "",
        refused=("the unit that the file states, 'EU' is unknown", '"g.v = v, mm/s"', '"g.v = v, 1"'),
    ),
    "an unknown unit that the map replaces.tdms": Kind(
        lambda path: tdms(path, "EU"), ["g.v = v, m/s"], "", left_out={"g.state": "it has words, no numbers"}
    ),
    "a wrong unit that the map replaces.csv": Kind(
        lines("t [s],v [kg]", *rows(lambda t, v, n: f"{t:.6f},{v}")), ["v = v, 1 m/s/V"]
    ),
    "sensitivity 0.csv": Kind(
        lines("t [s],v [V]", "0,1", "1,2"), ["v = v, 0 m/s/V"], refused=("a scale of 0 leaves nothing of the column",)
    ),
}

SECONDS = ["59.0", "59.5", "00.0", "00.5"]
KINDS |= {
    "Rigol.csv": Kind(
        lines(
            "X,CH1,CH2,Start,Increment,",
            "Sequence,Volt,Volt,-1.000000e-01,1.000000e-03",
            *(f"{i},{v:.6e},{n:.6e},," for i, (v, n) in enumerate(zip(V, N))),
        ),
        ["CH1 = v, 1 m/s/V", "CH2 = n, 1 rpm/V"],
        "",
        becomes={"v": ("m/s", V), "n": SPEED},
        told=("CH1        -1.49704 .. 1.49704 Volt, 200 values at 1000 Hz",),
    ),
    "Rigol, shorter rows.csv": Kind(
        lines(
            "X,CH1,Start,Increment,",
            "Sequence,VOLT,-1.000000e-01,1.000000e-03",
            *(f"{i},{v:.6e}," for i, v in enumerate(V)),
        ),
        ["CH1 = v, 1 m/s/V"],
        "",
    ),
    "Rigol, increment in a name.csv": Kind(
        lines("Time(s),CH1V,t0 = -1.000000e-01, tInc = 1.000000e-03,", *(f",{v:.6e},," for v in V)),
        ["CH1V = v, 1 m/s/V"],
        "",
    ),
    "Yokogawa.csv": Kind(
        lines(
            '"Header Size",15',
            '"Model Name","DL850"',
            '"TraceName","v","n"',
            '"BlockSize",200,200',
            '"VUnit","m/s","rpm"',
            '"HResolution",1.0e-03,1.0e-03',
            '"HOffset",0.0,0.0',
            '"HUnit","s","s"',
            '"Date","2024/03/01","2024/03/01"',
            '"Time","10:00:00.00","10:00:00.00"',
            "",
            *rows(lambda t, v, n: f",{v},{n}"),
        ),
        ["v = v", "n = n"],
        "",
        becomes={"v": ("m/s", V), "n": SPEED},
    ),
    "Siglent.csv": Kind(
        lines(
            "Record Length,Analog:200",
            "Sample Interval,Analog:0.001000000",
            "Vertical Units,CH1:V,CH2:V",
            "Source,CH1,CH2",
            "Second,Volt,Volt",
            *rows(lambda t, v, n: f"{t - 0.1:.12f},{v},{n}"),
        ),
        ["CH1 = v, 1 m/s/V"],
        "Source",
    ),
    "a logger.dat": Kind(
        lines(
            '"TOA5","bench","CR1000","1"',
            '"TIMESTAMP","RECORD","v"',
            '"TS","RN","m/s"',
            '"","","Smp"',
            *rows(lambda t, v, n: f'"2024-03-01 10:00:{t:06.3f}",{round(1e3 * t)},{v}'),
        ),
        time="TIMESTAMP",
    ),
    "names in the second line above the rows.csv": Kind(
        lines("time_unit;s", "trace_names;t;v", "description;;", *rows(lambda t, v, n: f";{t};{v}")),
        ["v = v, m/s"],
        "t, s",
    ),
    "separators alone above the rows.csv": Kind(lines("t,v", "s,m/s", ",", *rows(lambda t, v, n: f"{t:.6f},{v}"))),
    "names and units by blanks.txt": Kind(lines("# t [s] v [m/s]", *rows(lambda t, v, n: f"{t:.18e} {v:.18e}"))),
    "units behind a slash.csv": Kind(lines("t / (s);v / (m/s)", *rows(lambda t, v, n: f"{t:.6f};{v}"))),
    "thousands with a blank.csv": Kind(
        lines("t [s];n [U/min]", *rows(lambda t, v, n: f"{comma(t)};{german(n).replace('.', ' ')}")),
        ["n = n"],
        becomes={"n": SPEED},
    ),
    "thousands with a narrow blank.csv": Kind(
        lines("t [s];n [U/min]", *rows(lambda t, v, n: f"{t:.6f};{n:,.3f}".replace(",", "\u202f"))),
        ["n = n"],
        becomes={"n": SPEED},
    ),
    "a date beside the time of day.txt": Kind(
        lines("Date\tTime\tv [m/s]", *(f"0{i}.03.2024\t23:59:{s}\t{i}" for i in (1, 2) for s in SECONDS[:2])),
        time="Time",
        becomes={"v": ("m/s", [1.0, 1.0, 2.0, 2.0])},
        t=[0.0, 0.5, 86400.0, 86400.5],
        left_out={"Date": "it has dates without a time of day, which those of Time get"},
    ),
    "no date beside a time of day.csv": Kind(
        lines("Date,Time,v [m/s]", "31/12/2024,11:59:59 PM,1", ",12:00:00 AM,2", "01/01/2025,12:00:01 AM,3"),
        time="Time",
        refused=("row 3, column Time: '12:00:00 AM' has no date beside it",),
        in_one_line=True,
    ),
    "past midnight.csv": Kind(
        lines("t,v [m/s]", *(f"{'23:59' if s > '30' else '00:00'}:{s},{i}" for i, s in enumerate(SECONDS))),
        becomes={"v": ("m/s", [0.0, 1.0, 2.0, 3.0])},
        t=[0.0, 0.5, 1.0, 1.5],
        told=("the times of day have no date and pass midnight 1 time",),
    ),
    "past midnight with gaps, left out.csv": Kind(
        lines("t,v [m/s]", "11:59:59 PM,1", "11:59:59.5 PM,", ",2", "12:00:00 AM,3"),
        skip=True,
        becomes={"v": ("m/s", [1.0, 3.0])},
        t=[0.0, 1.0],
    ),
    "back by a second.csv": Kind(
        lines("t,v [m/s]", "10:00:00,1", "10:00:02,2", "10:00:01,3"),
        refused=("row 4, column t: the time 1 s falls",),
    ),
    "infinity in an early row.csv": Kind(
        lines("Time,Channel A", "(ms),(V)", "", *(f"{i},{'∞' if i == 9 else v}" for i, v in enumerate(V))),
        ["Channel A = v, 1 m/s/V"],
        "Time",
        refused=("row 13, column Channel A: '∞' is not a number",),
        in_one_line=True,
    ),
    "two decimal marks.csv": Kind(
        lines("t [s];v [m/s]", *rows(lambda t, v, n: f"{t:.6f};{comma(v)}")),
        refused=("column v is not read: its decimal mark is ',', that of other columns '.'",),
        in_one_line=True,
    ),
    "units alone.csv": Kind(lines("[s],[m/s]", *rows(lambda t, v, n: f"{t:.6f},{v}")), ["column 2 = v"], "column 1"),
    "an epoch in double.csv": Kind(
        lines("t [s],v [m/s]", "1709287200.000,1", "1709287200.001,2", "1709287200.002,3"),
        becomes={"v": ("m/s", [1.0, 2.0, 3.0])},
        t=np.array([0.0, 4194.0, 8389.0]) * 2.0**-22,  # the nearest doubles
        told=("the times are rounded to 2.4e-07 s, the digits of a double",),
    ),
    "overload of an instrument.csv": Kind(
        lines("t [s],v [m/s]", "0,1", "1,+9.9E+37", "2,+9.91E+37"),
        refused=("row 3 (and 4), column v: the value is infinite",),
    ),
    "an abscissa in ms.uff": Kind(
        lambda path: uff(path, "m/s", abscissa_inc=1.0, x=1e3 * T, abscissa_axis_units_lab="ms"), time=""
    ),
    "an abscissa in degrees.uff": Kind(
        lambda path: uff(path, "m/s", abscissa_axis_units_lab="deg"),
        time="",
        refused=("column v is not read: its abscissa is in 'deg', which is no unit of time",),
    ),
    "UNIT.h5": Kind(hdf5_with("UNIT", "m/s")),
    "unit_string in brackets.h5": Kind(hdf5_with("unit_string", "[m/s]")),
    "units in metadata.parquet": Kind(parquet_with_units),
}

UNCLOSED = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves its file open


@UNCLOSED
@pytest.mark.parametrize("name", KINDS)
def test_a_kind_of_file(tmp_path, name):
    check(KINDS[name], tmp_path / name)


def test_a_library_prints_no_lines_of_its_own(tmp_path, capfd):
    path = tmp_path / "cut.tdms"
    tdms(path, "m/s")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(UsageError, match=r"cut.tdms: is cut off: its last segment is not complete"):
        listed([path])
    assert capfd.readouterr() == ("", "")


def test_a_column_with_missing_times_is_proposed_as_the_time(tmp_path):
    path = tmp_path / "x.csv"
    KINDS["no time at both ends, left out.csv"].write(path)
    assert listed([path]).proposal == ChannelMap({"v": "v, m/s"}, "t, s", "")


@pytest.mark.parametrize(("written", "value"), [("1010", 1010.0), ("1.0100", 1.01)])
def test_a_number_in_doubt_is_read_in_both_ways_that_are_named(tmp_path, written, value):
    path = tmp_path / "x.csv"
    path.write_text("t [s];n [N]\n0;5\n1;1.010\n2;7\n")
    assert "1.010 may be 1010 or 1.0100" in listed([path]).text()
    path.write_text(path.read_text().replace("1.010", written))
    import_files([path], tmp_path / "x.mcap", ChannelMap.of_texts(["n = n"], "t"))
    assert lab.open(tmp_path / "x.mcap").measurements["n"].v.tolist() == [5.0, value, 7.0]


def parquet_of(**columns):
    def write(path):
        import pyarrow as pa
        from pyarrow import parquet

        parquet.write_table(pa.table(columns), path)

    return write


NONE = np.full(T.size, np.nan)
IN_EVERY_ROW = {
    "words.csv": (
        lines("t [s],v [m/s]", *(f"{t},{t if t < 0.15 else 'x'}" for t in T)),
        "row 152 (and 49 further rows, the last 201), column v: 'x' is not a number; correct these cells",
    ),
    "short rows.csv": (
        lines("t [s],v [m/s]", *(f"{t},1" if t < 0.15 else f"{t}" for t in T)),
        "row 152 (and 49 further rows, the last 201): 1 value, the other rows have 2",
    ),
    "values.csv": (
        lines("t [s],v [m/s]", *(f"{t},{1 if t < 0.15 else ''}" for t in T)),
        "row 152 (and 49 further rows, the last 201), column v: there is no value; --skip-missing leaves them out",
    ),
    "times.csv": (
        lines("t [s],v [m/s]", *(f"7,{v}" for v in V)),
        "row 3 (and 198 further rows, the last 201), column t: the time 7 s is that of the row before; --rate RATE",
    ),
    "clocks.csv": (
        lines("t,v [m/s]", *(f"10:00:{'00' if t < 0.15 else '99'}.{1000 * t:03.0f},1" for t in T)),
        "row 152 (and 49 further rows, the last 201), column t: '10:00:99.150' is not a time of day; --rate RATE",
    ),
    "values.h5": (
        lambda path: hdf5(path, t=(T, "s"), v=(NONE, "m/s")),
        "row 1 (and 199 further rows, the last 200), column v: there is no value; --skip-missing leaves them out",
    ),
    "times.parquet": (
        parquet_of(t=T[::-1], v=V),
        "row 2 (and 198 further rows, the last 200), column t: the time 0.198 s falls; --rate RATE",
    ),
    "values.mat": (
        lambda path: scipy_io.savemat(path, {"t": T, "v": NONE}),
        "row 1 (and 199 further rows, the last 200), column v: there is no value; --skip-missing leaves them out",
    ),
    "times.nc": (
        lambda path: netcdf(path, np.where(T < 0.1, np.nan, T)),
        "row 1 (and 99 further rows, the last 100), column t: there is no time; --skip-missing leaves them out",
    ),
}


@pytest.mark.parametrize("name", IN_EVERY_ROW)
def test_a_fault_that_many_rows_have_is_told_once_with_what_helps(tmp_path, name):
    write, told = IN_EVERY_ROW[name]
    path = tmp_path / name
    write(path)
    with pytest.raises(UsageError) as caught:
        import_files([path], tmp_path / "made.mcap", ChannelMap.of_texts(["v = v, m/s"], "t, s"))
    assert str(caught.value).startswith(f"{path}: {told}")
    assert len(str(caught.value).splitlines()) == 1


def test_columns_with_the_same_fault_in_the_same_rows_share_a_line(tmp_path):
    path = tmp_path / "wide.csv"
    rows_of = (f"{t},{value},{value},\n" for t, value in zip(T, np.where(T < 0.1, "1", "")))
    path.write_text("t [s],a [V],b [V],c [V]\n" + "".join(rows_of))
    with pytest.raises(UsageError) as caught:
        import_files([path], tmp_path / "made.mcap", ChannelMap.of_texts(["a = a", "b = b", "c = c"], "t"))
    assert str(caught.value).splitlines() == [
        f"{path}: row 2 (and 199 further rows, the last 201), column c: there is no value",
        f"{path}: row 102 (and 99 further rows, the last 201), column a (and 1 further column): there is no value",
        "--skip-missing leaves them out",
    ]
