"""More kinds of files, as strangers bring them: texts, times of day, LabVIEW, binary formats, entries of the map."""

import struct
import sys

import h5py
import numpy as np
import pytest
from measurement_kinds import Kind, N, T, V, check, comma, lines, rows, uff
from scipy import constants as c
from scipy import io as scipy_io

import rig as lab
from rig.errors import UsageError
from rig.record.imports.channel_map import ChannelMap
from rig.record.imports.import_run import import_files, listed

HEAD = "t [s];v [m/s]"
PLAIN = rows(lambda t, v, n: f"{t:.6f};{v}")
COUNTS = np.arange(200) + 50
Q16 = np.round(V / 2.0 * 32767.0).astype("<i2")
FORCES = np.round(1000.0 + N, 3)
RPM = 2.0 * np.pi / 60.0
EPOCH_MS = 1_709_287_200_000


def ended(text, end, encoding="utf-8"):
    """A text with another end of its lines."""
    return lambda path: path.write_bytes("".join(f"{row}{end}" for row in text).encode(encoding))


def grouped(blank):
    """Thousands that a blank of some width groups."""
    return lines("t [s];n [N]", *(f"{t:.6f};{n:,.3f}".replace(",", blank) for t, n in zip(T, FORCES)))


def stamped(form, v=V, t=T):
    """Times of day in a form of their own, one for each sample."""
    return lines("t;v [m/s]", *(f"{form(seconds)};{value}" for seconds, value in zip(t, v)))


LVM = """LabVIEW Measurement
Separator\tTab
Decimal_Separator\t.
X_Columns\t{columns}
Date\t2024/03/01
Time\t10:00:00.5
***End_of_Header***

Channels\t2
Samples\t200\t200
Date\t2024/03/01\t2024/03/01
Time\t10:00:00.5\t10:00:00.5
Y_Unit_Label\tm/s\tN
X_Dimension\t{dimension}\t{dimension}
X0\t0.0\t0.0
Delta_X\t0.001\t{step}
***End_of_Header***"""


def labview(columns, names, written, step="0.001", dimension="Time"):
    head = LVM.format(columns=columns, step=step, dimension=dimension).split("\n")
    return lines(*head, names, *written)


def segments(first):
    """A file of LabVIEW with two segments, of which the first has `first` rows."""
    head = LVM.format(columns="One", step="0.001", dimension="Time").split("\n")
    written = rows(lambda t, v, n: f"{t:.6f}\t{v}\t{n}")
    names = "X_Value\tv\tf\tComment"
    return lines(*head, names, *written[:first], "", *head[8:], names, *written[first:])


def changed_uff(path, change, **more):
    uff(path, abscissa_axis_units_lab="s", **more)
    path.write_bytes(change(path.read_bytes()))


def big_endian(data):
    """Data set 58b of the other byte order."""
    first, head, rest = data.split(b"\n", 2)
    return b"\n".join([first, head[:7] + b"     2" + head[13:], rest.replace(V.astype("<f8").tobytes(), swapped())])


def swapped():
    return V.astype(">f8").tobytes()


def tdms(path, values=V, **more):
    nptdms = pytest.importorskip("nptdms")
    about = {"wf_increment": T[1], "unit_string": "m/s", "wf_start_offset": 0.0, **more}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([nptdms.ChannelObject("g", "v", values, properties=about)])


def wav(extra=b"", riff=b"RIFF", size=None):
    """A WAV file of 16 bits, with further chunks before its samples."""

    def write(path):
        about = struct.pack("<HHIIHH", 1, 1, 1000, 2000, 2, 16)
        body = Q16.tobytes()
        chunks = b"WAVE" + extra + b"fmt " + struct.pack("<I", len(about)) + about
        chunks += b"data" + struct.pack("<I", size or len(body)) + body
        path.write_bytes(riff + struct.pack("<I", size or len(chunks)) + chunks)

    return write


# Of RF64: size of the file, of its samples, and their number
DS64 = b"ds64" + struct.pack("<IQQQI", 28, 72 + 2 * T.size, 2 * T.size, T.size, 0)


def hdf5(path, fill):
    with h5py.File(path, "w") as file:
        file["t"], file["v"] = T, V
        fill(file)


def nested_table(file):
    table = np.zeros(T.size, [("t", "f8"), ("vec", "f8", (3,)), ("inner", [("a", "f4"), ("b", "f8")])])
    table["vec"][:, 1] = N
    table["inner"]["b"] = V
    file["table"] = table


def odd_factors(file):
    file["m"], file["w"] = np.ones((200, 2)), N
    file["m"].attrs["scale_factor"] = [0.1, 0.2]
    file["w"].attrs["add_offset"] = "two"


def matlab_table(path):
    def fill(file):
        file["tab"] = np.arange(6, dtype=np.uint32)[None]
        file["tab"].attrs.update({"MATLAB_class": np.bytes_("table"), "MATLAB_object_decode": 3})

    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"], file["v"] = T[None], V[None]
        fill(file)
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])


def netcdf(values, kind="d", **about):
    def write(path):
        with scipy_io.netcdf_file(path, "w") as file:
            file.createDimension("n", T.size)
            file.createVariable("t", "d", ("n",))[:] = T
            file.createVariable("v", kind, ("n",))[:] = values
            file.variables["t"].units = "s"
            for key, value in {"units": "m/s", **about}.items():
                setattr(file.variables["v"], key, value)

    return write


def parquet(names, *columns):
    def write(path):
        import pyarrow as pa
        from pyarrow import parquet as of_pyarrow

        of_pyarrow.write_table(pa.table(list(columns), names=names), path)

    return write


def in_volts(entry, **more):
    """A column in V and one without a unit, with an entry of the map."""
    written = rows(lambda t, v, n: f"{t:.6f};{v};{v}")
    return Kind(lines("t [s];ch [V];q", *written), [entry], **more)


TEXTS = {
    "the comma separates and is the decimal mark.csv": Kind(
        lines("t [s],v [m/s],n [rpm]", *rows(lambda t, v, n: f"{comma(t)},{comma(v)},{comma(n, 3)}")),
        refused=("row 1 has 3 names, the rows have 6 cells", "separate the cells by semicolons"),
        in_one_line=True,
    ),
    "the comma separates and is the decimal mark, no names.csv": Kind(
        lines(*rows(lambda t, v, n: f"{comma(t)},{comma(v)}")),
        refused=("row 1 has '0,000000,0,000000': the comma separates the cells and is the decimal mark too",),
        in_one_line=True,
    ),
    "keys above the names.csv": Kind(
        lines(
            *("Sample Interval,0.001,", "Vertical Units,V,", "YUnit,V", "Label,,", "TIME,CH1"),
            *(row.replace(";", ",") for row in PLAIN),
        ),
        ["CH1 = v, m/s"],
        "TIME, s",
    ),
    "numbers with zeros first.csv": Kind(
        lines("v [m/s],code", *(f"{v},{i:04d}" for i, v in enumerate(V))),
        ["v = v", "code = code, 1"],
        "",
        "1 kHz",
        becomes={"v": ("m/s", V), "code": ("1", np.arange(200))},
    ),
    "decimal comma in quotes.csv": Kind(
        lines('"t [s]","v [m/s]"', *rows(lambda t, v, n: f'"{comma(t)}","{comma(v)}"'))
    ),
    "decimal comma with tabs.txt": Kind(lines("t [s]\tv [m/s]", *rows(lambda t, v, n: f"{comma(t)}\t{comma(v)}"))),
    "a thin space groups.csv": Kind(grouped("\u2009"), ["n = n"], becomes={"n": ("N", FORCES)}),
    "a figure space groups.csv": Kind(grouped("\u2007"), ["n = n"], becomes={"n": ("N", FORCES)}),
    "a typeset minus.csv": Kind(lines(HEAD, *(row.replace("-", "\u2212") for row in PLAIN))),
    "exponents of Fortran.txt": Kind(
        lines("t [s] v [m/s]", *rows(lambda t, v, n: f"{t:.6e} {v:.9e}".replace("e", "D")))
    ),
    "the separator in the first line.csv": Kind(
        ended(["sep=;", HEAD, *rows(lambda t, v, n: f"{comma(t)};{comma(v)}")], "\r\n", "utf-8-sig")
    ),
    "UTF-16 of the other order.csv": Kind(lines(f"\ufeff{HEAD}", *PLAIN, encoding="utf-16-be")),
    "UTF-16 of the other order without a mark.csv": Kind(lines(HEAD, *PLAIN, encoding="utf-16-be")),
    "UTF-32.csv": Kind(lines(HEAD, *PLAIN, encoding="utf-32")),
    "micro of Windows.csv": Kind(
        lines("t [s];v [µm/s];a [°]", *rows(lambda t, v, n: f"{t:.6f};{v};{v}"), encoding="cp1252"),
        ["v = v", "a = a"],
        becomes={"v": ("m/s", V * 1e-6), "a": ("rad", V * c.degree)},
    ),
    "lines of a Macintosh.csv": Kind(ended([HEAD, *PLAIN], "\r")),
    "separators behind the rows.csv": Kind(
        lines(HEAD, *(f"{row};;" for row in PLAIN)), left_out={"column 3": "it has no values", "column 4": ""}
    ),
    "blanks between the rows.csv": Kind(lines(HEAD, *(f"{row}\n   " for row in PLAIN))),
    "bars around the cells.txt": Kind(
        lines("| t [s] | v [m/s] |", "|---|---|", *(f"| {row.replace(';', ' | ')} |" for row in PLAIN))
    ),
    "names with a line break.csv": Kind(lines('"t\n[s]";"v\n[m/s]"', *PLAIN)),
    "names of numpy.savetxt.txt": Kind(lines("# t [s], v [m/s]", *(row.replace(";", " ") for row in PLAIN))),
    "names by semicolons above tabs.txt": Kind(lines(HEAD, *(row.replace(";", "\t") for row in PLAIN))),
    "more names than cells.csv": Kind(
        lines(f"{HEAD};w", *PLAIN),
        ["column 2 = v, m/s"],
        "column 1, s",
        left_out={"row 1": "it has 3 cells, the rows have 2: they get no names from it"},
        reported=("more names than cells.csv, row 1: it has 3 cells",),
    ),
    "the same name with two units.csv": Kind(
        lines("t [s];v [m/s];v [N]", *rows(lambda t, v, n: f"{t:.6f};{v};{n}")),
        ["v = v", "v (2) = f"],
        becomes={"v": ("m/s", V), "f": ("N", N)},
    ),
    "a slash before brackets.csv": Kind(lines("t/(s);v/(m/s)", *PLAIN)),
    "a smaller table above.csv": Kind(
        lines(HEAD, *PLAIN[:50], "", "t [s];f [N];x [m]", *(f"{row};1" for row in PLAIN)),
        ["f = f"],
        becomes={"f": ("N", V)},
        left_out={"above the rows": "50 lines with a number first, but not as many cells"},
        reported=("not read: a smaller table above.csv, above the rows: 50 lines",),
    ),
    "a larger table below.csv": Kind(
        lines(HEAD, *PLAIN, "", "t [s];f [N];x [m]", *(f"{row};1" for row in PLAIN[:20])),
        refused=("row 203 (and 20 further rows, the last 223): 3 values, the other rows have 2", "remove them"),
        in_one_line=True,
    ),
    "the header again.csv": Kind(
        lines(HEAD, *PLAIN[:100], HEAD, *PLAIN[100:]),
        refused=("row 102, column t (and 1 further column): 't [s]' is not a number",),
        in_one_line=True,
    ),
    "a footer.csv": Kind(
        lines(HEAD, *PLAIN, "End of data"),
        refused=("row 202: 1 value, the other rows have 2; complete these rows, or remove them",),
        in_one_line=True,
    ),
    "blanks in place of a value.txt": Kind(
        lines(HEAD, *PLAIN[:150], f"{T[150]:.6f};         NaN", *PLAIN[151:]),
        skip=True,
        becomes={"v": ("m/s", np.delete(V, 150))},
        t=np.delete(T, 150),
    ),
    "a directory": Kind(lambda path: path.mkdir(), refused=("is no file, but a directory",), in_one_line=True),
    "times closer than ns.csv": Kind(
        lines(HEAD, "0;1", "4e-10;2", "8e-10;3"),
        refused=("row 3 (and 4), column t: the time 4e-10 s is less than 1 ns after that of the row before",),
        in_one_line=True,
    ),
}

CLOCKS = {
    "AM and PM.csv": Kind(stamped(lambda t: f"1:23:{t + 5:06.3f} PM")),
    "minutes and seconds with a fraction.csv": Kind(stamped(lambda t: f"01:{t + 5:06.3f}")),
    "a zone of hours.csv": Kind(stamped(lambda t: f"2024-03-01T10:00:{t:09.6f}+01")),
    "UTC.csv": Kind(stamped(lambda t: f"2024-03-01 10:00:{t:09.6f} UTC")),
    "the zone changes.csv": Kind(
        lines(
            "t;v [m/s]", "2024-10-27T02:59:59.5+02:00;1", "2024-10-27T02:00:00+01:00;2", "2024-10-27T02:00:01+0100;3"
        ),
        becomes={"v": ("m/s", [1.0, 2.0, 3.0])},
        t=[0.0, 0.5, 1.5],
    ),
    "the clock goes back.csv": Kind(
        lines("t;v [m/s]", "2024-10-27 02:59:59;1", "2024-10-27 02:00:00;2", "2024-10-27 02:00:01;3"),
        refused=("row 3, column t: the time -3599 s falls; --rate RATE takes no times from the file",),
    ),
    "a date without marks.csv": Kind(stamped(lambda t: f"20240301 10:00:{t:09.6f}")),
    "numbers like dates.csv": Kind(
        lines("t;n;v [m/s]", *rows(lambda t, v, n: f"10:00:{t:09.6f};20240301;{v}")),
        ["v = v", "n = n, 1"],
        becomes={"v": ("m/s", V), "n": ("1", np.full(200, 20240301.0))},
    ),
    "more digits than ns.csv": Kind(stamped(lambda t: f"2024-03-01 10:00:{t:09.6f}000000")),
    "milliseconds behind a colon.csv": Kind(stamped(lambda t: f"2024-03-01 10:00:00:{1e3 * t:03.0f}")),
    "a month by name, two digits.csv": Kind(stamped(lambda t: f"01-Mar-24 10:00:{t:09.6f}")),
    "the month first, by name.csv": Kind(stamped(lambda t: f"Mar 1, 2024 10:00:{t:09.6f} AM")),
    "a German month.csv": Kind(stamped(lambda t: f"1. März 2024 10:00:{t:09.6f}")),
    "a leap second.csv": Kind(
        lines("t;v [m/s]", "2016-12-31 23:59:59;1", "2016-12-31 23:59:60;2", "2017-01-01 00:00:01;3"),
        becomes={"v": ("m/s", [1.0, 2.0, 3.0])},
        t=[0.0, 1.0, 2.0],
    ),
    "ms since 1970.csv": Kind(stamped(lambda t: str(EPOCH_MS + round(1e3 * t))), time="t, ms"),
    "us since 1970.csv": Kind(stamped(lambda t: str(1000 * EPOCH_MS + round(1e6 * t))), time="t, us"),
    "ns since 1970.csv": Kind(stamped(lambda t: str(1_000_000 * EPOCH_MS + round(1e9 * t))), time="t, ns"),
    "days of a spreadsheet.csv": Kind(
        stamped(lambda t: str(45352.0 + t * 1000.0 / 1024.0)), time="t, d", t=T * 1000.0 * 84.375
    ),
}

LABVIEW = {
    "two channels of one name.lvm": Kind(
        labview("One", "X_Value\tch\tch\tComment", rows(lambda t, v, n: f"{t:.6f}\t{v}\t{n}")),
        ["ch = v", "ch (2) = f"],
        "X_Value",
        becomes={"v": ("m/s", V), "f": ("N", N)},
    ),
    "two rates.lvm": Kind(
        labview("No", "X_Value\tv\tf\tComment", rows(lambda t, v, n: f"\t{v}\t{n}"), step="0.002"),
        ["f = f"],
        "",
        becomes={"f": ("N", N)},
        t=2.0 * T,
        told=("200 values at 1000 Hz", "200 values at 500 Hz"),
    ),
    "a time for each channel.lvm": Kind(
        labview("Multi", "X_Value\tv\tX_Value\tf", rows(lambda t, v, n: f"{t}\t{v}\t{2 * t}\t{n}"), step="0.002"),
        ["f = f"],
        "X_Value",
        becomes={"f": ("N", N)},
        t=2.0 * T,
    ),
    "a remark in the first row.lvm": Kind(
        labview(
            "No",
            "X_Value\tv\tf\tComment",
            [f"\t{v}\t{n}\t{'' if i else 'knock'}" for i, (v, n) in enumerate(zip(V, N))],
        ),
        ["v = v", "f = f"],
        "",
        becomes={"v": ("m/s", V), "f": ("N", N)},
        left_out={"Comment": "it has words, no numbers, such as 'knock'"},
    ),
    "frequencies.lvm": Kind(
        labview("No", "X_Value\tv\tf\tComment", rows(lambda t, v, n: f"\t{v}\t{n}"), dimension="Frequency"),
        time="",
        refused=("no time for v",),
    ),
    "a smaller segment above.lvm": Kind(
        segments(20), time="X_Value", refused=("row 40: another segment of LabVIEW begins here",), in_one_line=True
    ),
    "a segment of the same size.lvm": Kind(
        segments(100), time="X_Value", refused=("another segment of LabVIEW begins here",), in_one_line=True
    ),
}

BINARY = {
    "the other byte order.uff": Kind(lambda path: changed_uff(path, big_endian, binary=1), time=""),
    "no increment.uff": Kind(
        lambda path: changed_uff(path, lambda data: data.replace(b"1.00000e-03", b"0.00000e+00")),
        time="",
        refused=('no time for v: add --time "COLUMN, s" or --rate',),
    ),
    "a falling abscissa and a rate.uff": Kind(
        lambda path: changed_uff(path, lambda data: data.replace(b" 1.00000e-03", b"-1.00000e-03")),
        time="",
        rate="1 kHz",
    ),
    "lines that are missing.uff": Kind(
        lambda path: changed_uff(
            path, lambda data: b"".join([*data.splitlines(True)[:20], *data.splitlines(True)[23:]])
        ),
        time="",
        refused=("is cut off: v has 188 values of 200",),
    ),
    "an abscissa in ms.tdms": Kind(lambda path: tdms(path, wf_increment=1.0, wf_xunit_string="ms"), ["g.v = v"], ""),
    "an abscissa in Hz.tdms": Kind(
        lambda path: tdms(path, wf_increment=1.0, wf_xunit_string="Hz"),
        ["g.v = v"],
        "",
        refused=("column g.v is not read: its abscissa is in 'Hz', which is no unit of time",),
    ),
    "a negative increment.tdms": Kind(
        lambda path: tdms(path, wf_increment=-1.0), ["g.v = v"], "", refused=("no time for g.v",)
    ),
    "a given rate.tdms": Kind(tdms, ["g.v = v"], "", "500 Hz", t=2.0 * T),
    "a text.tdms": Kind(lines(HEAD, *PLAIN), refused=("is no TDMS file: it does not begin with TDSm",)),
    "remarks of a field recorder.wav": Kind(
        wav(b"bext" + struct.pack("<I", 602) + bytes(602)), ["ch1 = v"], "", becomes={"v": ("1", Q16 / 32768.0)}
    ),
    "RF64.wav": Kind(wav(DS64, b"RF64", 2**32 - 1), ["ch1 = v"], "", becomes={"v": ("1", Q16 / 32768.0)}),
    "a given rate.wav": Kind(wav(), ["ch1 = v"], "", "500 Hz", becomes={"v": ("1", Q16 / 32768.0)}, t=2.0 * T),
    "a table of MATLAB.mat": Kind(
        matlab_table,
        ["v = v, m/s"],
        "t, s",
        left_out={"tab": "it is an object of MATLAB (table); save its columns as vectors"},
    ),
    "ns since 1970.mat": Kind(
        lambda path: scipy_io.savemat(path, {"t": 1_000_000 * (EPOCH_MS + np.arange(200)), "v": V}),
        ["v = v, m/s"],
        "t, ns",
    ),
    "days since year 0.mat": Kind(
        lambda path: scipy_io.savemat(path, {"t": 739312.0 + np.arange(200) / 1024.0, "v": V}),
        ["v = v, m/s"],
        "t, d",
        t=np.arange(200) * 84.375,
    ),
    "tables in a table.h5": Kind(
        lambda path: hdf5(path, nested_table),
        ["table.inner.b = v, m/s", "table.vec.2 = n, N"],
        "t, s",
        becomes={"v": ("m/s", V), "n": ("N", N)},
    ),
    "odd factors.h5": Kind(
        lambda path: hdf5(path, odd_factors),
        ["v = v, m/s"],
        "t, s",
        left_out={"m": "it has several factors", "w": "its scale_factor or add_offset is no number"},
    ),
    "large images.h5": Kind(
        lambda path: hdf5(path, lambda file: file.create_dataset("x", (99, 99, 10**6), "f8", chunks=(9, 9, 9))),
        ["v = v, m/s"],
        "t, s",
        left_out={"x": "it has 3 dimensions"},
    ),
    "a large vector.h5": Kind(
        lambda path: hdf5(path, lambda file: file.create_dataset("x", (10**10,), "f4", chunks=(10**6,))),
        ["v = v, m/s"],
        "t, s",
        left_out={"x": "its 10000000000 values take 74.5 GiB, more than 2; save a part of it"},
    ),
    "without a sign.nc": Kind(
        netcdf(COUNTS.astype(np.uint8).view(np.int8), "b", _Unsigned="true"), becomes={"v": ("m/s", COUNTS)}
    ),
    "never written.nc": Kind(
        netcdf(np.where(COUNTS == 57, 9.969209968386869e36, V)), refused=("row 8, column v: the value is infinite",)
    ),
    "labels twice.parquet": Kind(
        parquet(["v [N]", "t [s]", "v [N]"], N, T, V),
        ["v = f", "v (2) = v"],
        becomes={"f": ("N", N), "v": ("N", V)},
    ),
    "ns since 1970.parquet": Kind(parquet(["t", "v [m/s]"], 1_000_000 * (EPOCH_MS + np.arange(200)), V), time="t, ns"),
}

MAPS = {
    "a sensitivity of a data sheet.csv": in_volts(
        "ch = v, 100 mV/g", refused=("not the inverse", 'write "ch = v, 0.01 g/mV"')
    ),
    "the other way round.csv": in_volts("ch = v, 0.01 g_n/mV", becomes={"v": ("m/s^2", V * 10.0 * c.g)}),
    "a sensitivity in brackets.csv": in_volts(
        "q = v, 10 mV/(m/s^2), offset 1 m/s^2", refused=('write "q = v, 0.1 (m/s^2)/mV, offset 1 m/s^2"',)
    ),
    "brackets the other way round.csv": in_volts(
        "q = v, 0.1 (m/s^2)/mV, offset 1 m/s^2", becomes={"v": ("m/s^2", V * 0.1 + 1.0)}
    ),
    "a rate of voltage.csv": in_volts("q = v, 2 V/s", becomes={"v": ("V/s", V * 2.0)}),
    "blanks beside the slash.csv": in_volts("q = v, 1 / min", becomes={"v": ("rad/s", V * RPM)}),
    "turns per minute with blanks.csv": in_volts("q = v, 2 U / min", becomes={"v": ("rad/s", 2.0 * V * RPM)}),
    "an offset in degrees.csv": in_volts("q = v, degC, offset 10 degC", becomes={"v": ("K", V + 283.15)}),
    "degrees for kelvin.csv": in_volts("q = v, 5 K/V, offset 10 degC", becomes={"v": ("K", 5.0 * V + 283.15)}),
    "an umlaut in a name.csv": in_volts("q = größe, m", refused=("is no name; expected letters from A to Z",)),
    "a rate above 1 MHz.csv": in_volts("q = v, m", time="", rate="2.5 MHz", becomes={"v": ("m", V)}, t=T / 2500.0),
}

UNCLOSED = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves its file open


@UNCLOSED
@pytest.mark.parametrize("name", KINDS := {**TEXTS, **CLOCKS, **LABVIEW, **BINARY, **MAPS})
def test_a_kind_of_file(tmp_path, name):
    check(KINDS[name], tmp_path / name)


def test_a_rate_beyond_the_ns_of_a_recording_is_refused(tmp_path):
    path = tmp_path / "x.csv"
    lines("v [m/s]", "1", "2")(path)
    with pytest.raises(UsageError, match="--rate 2 GHz: expected more than 0 Hz, and at most 1 GHz"):
        import_files([path], tmp_path / "x.mcap", ChannelMap.of_texts(["v = v"], rate="2 GHz"))


def test_a_list_of_many_columns_takes_little_memory(tmp_path):
    """What stands for no value was kept for each column: 450 KB."""
    resource = pytest.importorskip("resource")
    path = tmp_path / "wide.csv"
    written = [";".join(f"{k + i / 8}" for i in range(4000)) for k in range(3)]
    lines(";".join(f"c{i} [m/s]" for i in range(4000)), *written)(path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert len(listed([path]).rows) == 4000
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown * (1 if sys.platform == "darwin" else 1024) < 400e6


def pulses(name, late):
    pulse = np.exp(-(((T - 0.1 - late) / 0.02) ** 2))
    return lines(f"t [s];pulse [V];{name} [m/s]", *(f"{t:.6f};{p:.9f};{v}" for t, p, v in zip(T, pulse, V)))


def test_a_channel_that_two_joined_files_have_is_told(tmp_path):
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for path in paths:
        pulses("v", 0.0)(path)
    given = ChannelMap.of_texts(["pulse = pulse", "v = v"], "t")
    with pytest.raises(UsageError, match=r"b\.csv: a\.csv has a channel v too; rename its column in one of the files"):
        import_files(paths, tmp_path / "x.mcap", given, "pulse")
    pulses("w", 0.0)(paths[1])
    given = ChannelMap.of_texts(["pulse = pulse", "v = v"], "t")
    with pytest.raises(UsageError, match=r"b\.csv: it has no channel beside pulse, which the first file has too"):
        import_files(paths, tmp_path / "x.mcap", given, "pulse")


def test_a_file_with_a_rate_joins_one_with_times(tmp_path):
    """A WAV, which begins 0.05 s later, beside a table."""
    paths = [tmp_path / "a.csv", tmp_path / "b.wav"]
    t = np.arange(4000) / 4000.0
    pulses = [1.0 / (1.0 + np.exp(-(t - late) / 5e-3)) for late in (0.4, 0.35)]
    lines("t [s];pulse [V];v [m/s]", *(f"{x:.6f};{p:.9f};{p}" for x, p in zip(t, pulses[0])))(paths[0])
    scipy_io.wavfile.write(paths[1], 4000, np.stack([pulses[1], t], axis=1))
    given = ChannelMap.of_texts(["pulse = pulse", "v = v", "ch1 = pulse, 1 V", "ch2 = w, 1 m/s"], "t")
    import_files(paths, tmp_path / "x.mcap", given, "pulse > 0.5 V")
    samples = lab.open(tmp_path / "x.mcap").measurements["w"]
    assert samples.v.tolist() == t.tolist()
    assert samples.t_ns * 1e-9 == pytest.approx(t + 0.05, abs=1e-6)  # the pulse is not straight between two samples


def test_files_whose_times_begin_apart_are_joined(tmp_path):
    """One counts ms since 1970, the other seconds."""
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    pulses("v", 0.0)(paths[0])
    pulse = np.exp(-(((T - 0.13) / 0.02) ** 2))
    late = (f"{EPOCH_MS + 1e3 * t:.0f};{p:.9f};{v}" for t, p, v in zip(T, pulse, V))
    lines("t [ms];pulse [V];w [m/s]", *late)(paths[1])
    given = ChannelMap.of_texts(["pulse = pulse", "v = v", "w = w"], "t")
    made = import_files(paths, tmp_path / "x.mcap", given, "pulse > 0.5 V")
    assert f"moved by {-0.03 - EPOCH_MS / 1e3:.9g} s" in made.text()
    assert made.bases[1].to_json()["begin"] == EPOCH_MS / 1e3
