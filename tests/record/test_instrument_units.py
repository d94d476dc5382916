"""What instruments write has its meaning, in SI; two meanings are asked for, and every remedy that is named works."""

import re

import numpy as np
import pytest
from scipy import constants as c

import rig as lab
from rig.errors import UsageError
from rig.record.imports.channel_map import ChannelMap
from rig.record.imports.import_run import import_files, listed
from rig.record.imports.instrument_units import UnitFault, meaning

RPM = ("rad/s", 2.0 * np.pi / 60.0)
MEANINGS = {
    **dict.fromkeys(["rpm", "RPM", "U/min", "1/min", "min-1", "min^-1", "min⁻¹", "r/min", "rev/min", "UPM"], RPM),
    **dict.fromkeys(["Nm", "N m", "N*m", "N·m", "N.m", "N-m", "newton meter"], ("N*m", 1.0)),
    **dict.fromkeys(["[m/s²]", "<m/s^2>", "ms^-2", "metres per second/s"], ("m/s^2", 1.0)),
    "kOhm": ("ohm", 1e3),
    "Ns/m": ("N*s/m", 1.0),
    "kgm²": ("kg*m^2", 1.0),
    "tr/min": RPM,
    "mNm": ("N*m", 1e-3),
    "Ncm": ("N*m", 1e-2),
    "kNm": ("N*m", 1e3),
    "Nmm": ("N*m", 1e-3),
    **dict.fromkeys(["ft-lb", "lbf ft", "ft*lbf", "lbf-ft"], ("N*m", c.lbf * c.foot)),
    "in-lb": ("N*m", c.lbf * c.inch),
    **dict.fromkeys(["deg", "°", "degrees", "Degree"], ("rad", c.degree)),
    "deg/s": ("rad/s", c.degree),
    "°/s": ("rad/s", c.degree),
    "rad": ("rad", 1.0),
    "mrad": ("rad", 1e-3),
    **dict.fromkeys(["in", "inch", "Inches", '"'], ("m", c.inch)),
    **dict.fromkeys(["in/s", "ips", "in/sec"], ("m/s", c.inch)),
    "ft": ("m", c.foot),
    "ft/s": ("m/s", c.foot),
    "mils": ("m", 1e-3 * c.inch),
    "mph": ("m/s", c.mph),
    **dict.fromkeys(["um", "µm", "μm", "micron"], ("m", 1e-6)),
    "nm": ("m", 1e-9),
    "mm": ("m", 1e-3),
    **dict.fromkeys(["mm/s2", "mm/s²", "mm/s^2", "mm/s**2", "mm s-2", "mm·s⁻²", "mm/s/s"], ("m/s^2", 1e-3)),
    **dict.fromkeys(["m s-1", "m/s", "m*s^-1", "m·s⁻¹", "m/sec", "m.s-1"], ("m/s", 1.0)),
    "km/h": ("m/s", c.kmh),
    "g_n": ("m/s^2", c.g),
    "gn": ("m/s^2", c.g),
    "mg_n": ("m/s^2", 1e-3 * c.g),
    "lbf": ("N", c.lbf),
    "kp": ("N", c.kgf),
    "kgf": ("N", c.kgf),
    "daN": ("N", 10.0),
    "kN": ("N", 1e3),
    "psi": ("Pa", c.psi),
    "bar": ("Pa", c.bar),
    "mbar": ("Pa", 100.0),
    "hPa": ("Pa", 100.0),
    "MPa": ("Pa", 1e6),
    "N/mm2": ("Pa", 1e6),
    "N/mm²": ("Pa", 1e6),
    "kp/cm2": ("Pa", c.kgf * 1e4),
    "Torr": ("Pa", c.torr),
    **dict.fromkeys(["Volt", "Volts", "V", "volt"], ("V", 1.0)),
    "mV": ("V", 1e-3),
    "mVolt": ("V", 1e-3),
    "Amp": ("A", 1.0),
    "mA": ("A", 1e-3),
    "kΩ": ("ohm", 1e3),
    "Ohm": ("ohm", 1.0),
    **dict.fromkeys(["-", "1", "[-]", "none", "None", "V/V"], ("1", 1.0)),
    "%": ("1", 1e-2),
    "mV/V": ("1", 1e-3),
    **dict.fromkeys(["µε", "um/m", "µm/m", "microstrain"], ("1", 1e-6)),
    **dict.fromkeys(["s", "sec", "Seconds", "Sek"], ("s", 1.0)),
    "msec": ("s", 1e-3),
    "min": ("s", 60.0),
    "h": ("s", 3600.0),
    "Hz": ("Hz", 1.0),
    "kHz": ("Hz", 1e3),
    "1/s": ("Hz", 1.0),
    "N*s/m": ("N*s/m", 1.0),
    "kg/s": ("N*s/m", 1.0),
    "l/min": ("m^3/s", 1e-3 / 60.0),
    "kW": ("W", 1e3),
    "kJ": ("J", 1e3),
    "pC": ("C", 1e-12),
    "kg": ("kg", 1.0),
    "kg/m^3": ("kg/m^3", 1.0),
    "degC/s": ("K/s", 1.0),
    "N*m/rad": ("N*m/rad", 1.0),
    "N/mm": ("N/m", 1e3),
}


@pytest.mark.parametrize("text", MEANINGS)
def test_what_instruments_write_has_one_meaning(text):
    unit, factor = MEANINGS[text]
    found = meaning(text)
    assert (found.unit, found.shift) == (unit, 0.0)
    assert found.factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize("text", ["degC", "°C", "deg C", "Celsius", "Grad C", "° C", "℃"])
def test_degrees_celsius_have_their_zero(text):
    assert meaning(text) == ("K", 1.0, 273.15)


def test_degrees_fahrenheit_have_their_zero():
    unit, factor, shift = meaning("°F")
    assert unit == "K"
    assert [factor * 32.0 + shift, factor * 212.0 + shift] == pytest.approx([273.15, 373.15], rel=1e-15)


@pytest.mark.parametrize(
    "text", ["EU", "Nm/s^4", "mol/s", "U", "counts/g_n", "m*", "(m", "kg m kg m kg", "x" * 99, "", "RH"]
)
def test_what_is_unknown_or_no_quantity_of_a_bench_is_not_guessed(text):
    with pytest.raises(UnitFault, match=r"is unknown|which no bench measures") as caught:
        meaning(text)
    assert not caught.value.ways


def made(tmp_path, entry, unit, value=2.0):
    """The channel that a column in `unit` becomes by an entry of the map: its unit and value."""
    path, out = tmp_path / "x.csv", tmp_path / "x.mcap"
    path.write_text(f"t [s];ch [{unit}]\n0;{value}\n1;{value}\n2;{value}\n")
    import_files([path], out, ChannelMap.of_texts([entry], "t"), replace=True)
    run = lab.open(out)
    return run.units["meas/a"], float(run.measurements["a"].v[1])


AMBIGUOUS = {
    "g": {("m/s^2", 2.0 * c.g), ("kg", 2e-3)},
    "mg": {("m/s^2", 2e-3 * c.g), ("kg", 2e-6)},
    "G": {("m/s^2", 2.0 * c.g), ("T", 2e-4)},
    "C": {("K", 275.15), ("C", 2.0)},
    "F": {("K", 2.0 / 1.8 + 459.67 / 1.8), ("F", 2.0)},
    "S": {("s", 2.0), ("S", 2.0)},
    "ms^-1": {("m/s", 2.0), ("Hz", 2e3)},
    "kg/cm²": {("Pa", 2e4 * c.kgf), ("kg/m^2", 2e4)},
    "mil": {("m", 2e-3 * c.inch), ("rad", 2e-3)},
    "Grad": {("rad", 2.0 * c.degree), ("rad", np.pi / 100.0)},
    "lb": {("N", 2.0 * c.lbf), ("kg", 2.0 * c.lb)},
    "lbs": {("N", 2.0 * c.lbf), ("kg", 2.0 * c.lb)},
    "oz": {("N", c.lbf / 8.0), ("kg", 2.0 * c.oz)},
    "g/s": {("m/s^3", 2.0 * c.g), ("N*s/m", 2e-3)},
}


@pytest.mark.parametrize("unit", AMBIGUOUS)
@pytest.mark.parametrize("entry", ["ch = a", "ch = a, {unit}", "ch = a, 2 {unit}/V"])
def test_a_unit_with_two_meanings_is_asked_for_and_both_ways_to_write_it_work(tmp_path, unit, entry):
    stated = "V" if "/V" in entry else unit
    with pytest.raises(UsageError, match="has two meanings; write") as caught:
        made(tmp_path, entry.format(unit=unit), stated, 1.0 if "/V" in entry else 2.0)
    ways = re.findall(r'"(ch = [^"]+)"', str(caught.value))
    assert len(ways) == 2
    found = [made(tmp_path, way, stated, 1.0 if "/V" in entry else 2.0) for way in ways]
    for (name, value), (of_unit, expected) in zip(sorted(found), sorted(AMBIGUOUS[unit]), strict=True):
        assert (name, value) == (of_unit, pytest.approx(expected, rel=1e-12))


@pytest.mark.parametrize("unit", ["EU", "dB", "dB re 20 uPa", "dBV", "mol", "kg/A"])
def test_the_remedies_of_a_unit_that_cannot_be_used_work(tmp_path, unit):
    with pytest.raises(UsageError, match="state another one in the map") as caught:
        made(tmp_path, "ch = a", unit)
    ways = re.findall(r'"(ch = [^"]+)"', str(caught.value))
    assert [made(tmp_path, way, unit) for way in ways] == [("m/s", 2e-3), ("1", 2.0)]


@pytest.mark.parametrize(
    ("stated", "entry", "unit", "value"),
    [
        ("kg", "ch = a, N", "N", 2.0),
        ("m/s", "ch = a, mm/s", "m/s", 2e-3),
        ("EU", "ch = a, 3 mm/EU", "m", 6e-3),
        ("m/s", "ch = a, 3 N/(m/s)", "N", 6.0),
        ("m/s", "ch = a, 3 N/V", "N", 6.0),
        ("mV", "ch = a, 3 N/V", "N", 6e-3),
        ("mV/V", "ch = a, 2 kN/(mV/V)", "N", 4e3),
        ("uV/V", "ch = a, 2 kN/(mV/V)", "N", 4.0),
        ("mA", "ch = a, 2 bar/mA, offset -8 bar", "Pa", -4e5),
        ("g", "ch = a, g_n, offset 1 g", "m/s^2", 3.0 * c.g),
    ],
)
def test_the_map_decides_over_the_file(tmp_path, stated, entry, unit, value):
    assert made(tmp_path, entry, stated) == (unit, pytest.approx(value, rel=1e-12))


@pytest.mark.parametrize("stated", ["V", "mV/V", "EU", "m/s"])
def test_a_scale_that_is_not_per_the_unit_of_the_column_is_refused_with_one_that_is(tmp_path, stated):
    with pytest.raises(UsageError, match="expected a scale per") as caught:
        made(tmp_path, "ch = a, 3 N, offset 1 N", stated)
    (way,) = re.findall(r'"(ch = [^"]+)"', str(caught.value))
    assert made(tmp_path, way, stated) == ("N", pytest.approx(7.0, rel=1e-12))


def test_a_unit_that_the_map_replaces_is_told(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("t [s];ch [kg];k [mm/sec]\n0;1;1\n1;2;2\n")
    result = import_files([path], tmp_path / "x.mcap", ChannelMap.of_texts(["ch = a, N", "k = b, mm/s"], "t"))
    assert result.text().count("the map decides") == 1
    assert "x.csv, ch (the file states kg; the map decides)" in result.text()


def test_the_list_of_columns_names_both_meanings_and_proposes_none_of_them(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("t [s];acc [g];x [EU];n [U/min]\n0;1;1;1\n1;2;2;2\n2;1;1;1\n")
    found = listed([path])
    assert found.proposal.channels == {"acc": "acc, ?", "x": "x, ?", "n": "n, U/min"}
    assert "'g' has two meanings: g_n (standard gravity, 9.80665 m/s^2) or gram (0.001 kg)" in found.text()
    assert "'EU' is unknown" in found.text()


def test_a_nested_table_in_the_file_of_the_map_is_named_with_what_to_write(tmp_path, rig):
    (tmp_path / "x.csv").write_text("t [s];run.v [m/s]\n0;1\n1;2\n")
    (tmp_path / "import.toml").write_text('time = "t"\n[channels]\nrun.v = "v, m/s"\n')
    code, _, err = rig("import", tmp_path / "x.csv")
    assert (code, f"{tmp_path / 'import.toml'}: [channels] run is a table" in err) == (2, True)
    (entry,) = re.findall(r'"run\.v" = "[^"]+"', err)
    (tmp_path / "import.toml").write_text(f'time = "t"\n[channels]\n{entry}\n')
    assert rig("import", tmp_path / "x.csv")[0] == 0


@pytest.mark.parametrize("join", ["pulse > 1 V", "pulse"])
def test_missing_times_and_values_of_files_to_be_joined_are_faults_or_are_left_out(tmp_path, join):
    t = np.arange(300) / 100.0
    for name, late in (("a", 0.0), ("b", 0.25)):
        pulse = np.exp(-(((t - 1.0 - late) / 0.2) ** 2)) * 3.0
        cells = [[f"{x:.6f}", f"{p:.9f}", "1"] for x, p in zip(t, pulse)]
        cells[0][0] = cells[299][0] = cells[40][0] = ""
        cells[50][1] = "nan"
        rows = "\n".join(";".join(row) for row in cells)
        (tmp_path / f"{name}.csv").write_text(f"t [s];pulse [V];{name} [m/s]\n{rows}\n")
    paths, mapped = (
        [tmp_path / "a.csv", tmp_path / "b.csv"],
        ChannelMap.of_texts(["pulse = pulse", "a = a", "b = b"], "t"),
    )
    with pytest.raises(UsageError) as caught:
        import_files(paths, tmp_path / "x.mcap", mapped, join)
    for name in ("a", "b"):
        assert f"{name}.csv: row 2 (and 42, 301), column t: there is no time" in str(caught.value)
    import_files(paths, tmp_path / "x.mcap", mapped, join, skip_missing=True)
    run = lab.open(tmp_path / "x.mcap")
    first = [run.measurements[name].t_ns[0] * 1e-9 for name in "ab"]  # the pulse of b lies 0.25 s later in its own time
    assert first == pytest.approx([0.25, 0.0], abs=5e-3)  # half a sample
    assert run.measurements["b"].v.size == 297
