"""A kind of measurement file that is made from known signals, and the check of what it becomes."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

import rig as lab
from rig.errors import UsageError
from rig.record.imports.channel_map import ChannelMap
from rig.record.imports.import_run import import_files, listed

T = np.arange(200) / 1000.0
V = np.round(1.5 * np.sin(40.0 * np.pi * T), 6)
N = np.round(3000.0 * T / T[-1], 3)  # from 0 to 3000


@dataclass
class Kind:
    """A kind of file: how it is written and mapped, and what it becomes, or why not."""

    write: Any
    mapped: list[str] = field(default_factory=lambda: ["v = v"])
    time: str = "t"
    rate: str = ""
    skip: bool = False
    becomes: dict[str, Any] = field(default_factory=lambda: {"v": ("m/s", V)})
    t: Any = field(default_factory=lambda: T)
    left_out: dict[str, str] = field(default_factory=dict)
    refused: tuple[str, ...] = ()
    told: tuple[str, ...] = ()
    """What the list of columns says."""
    reported: tuple[str, ...] = ()
    """What the import says."""
    in_one_line: bool = False


def lines(*rows, encoding="utf-8"):
    return lambda path: path.write_bytes("".join(f"{row}\n" for row in rows).encode(encoding))


def comma(x, digits=6):
    return f"{x:.{digits}f}".replace(".", ",")


def rows(form):
    """A row for each sample; `form` gets t, v and n."""
    return [form(t, v, n) for t, v, n in zip(T, V, N)]


def uff(path, unit="m/s", **more):
    """Write V as a data set 58 of even times."""
    pyuff = pytest.importorskip("pyuff")
    about = {
        "binary": 0,
        "func_type": 1,
        "rsp_node": 1,
        "rsp_dir": 1,
        "ref_dir": 1,
        "ref_node": 1,
        "data": V,
        "x": T,
        "id1": "v",
        "rsp_ent_name": "a",
        "ref_ent_name": "b",
        "abscissa_spacing": 1,
        "abscissa_spec_data_type": 17,
        "ordinate_spec_data_type": 11,
        "num_pts": T.size,
        "orddenom_spec_data_type": 0,
        "abscissa_inc": T[1],
        "abscissa_min": 0.0,
        "ord_data_type": 4,
        "ordinate_axis_units_lab": unit,
        **more,
    }
    pyuff.UFF(str(path)).write_sets([pyuff.prepare_58(**about)], "add")


def check(kind, path):
    """Write a file of this kind and import it: it becomes what it has to, or is refused in these words."""
    out = path.with_name("made.mcap")
    kind.write(path)
    given = ChannelMap.of_texts(kind.mapped, kind.time, kind.rate)
    if kind.refused:
        with pytest.raises(UsageError) as caught:
            import_files([path], out, given, skip_missing=kind.skip)
        told = str(caught.value)
        assert all(part in told for part in kind.refused), told
        assert str(path) in told
        assert not out.exists()
        if kind.in_one_line:
            assert len(told.splitlines()) == 1
        return
    report = import_files([path], out, given, skip_missing=kind.skip)
    run = lab.open(out)
    for channel, (unit, values) in kind.becomes.items():
        assert run.units[f"meas/{channel}"] == unit
        samples = run.measurements[channel]
        assert samples.v == pytest.approx(np.asarray(values), rel=1e-12, abs=1e-15)
        assert samples.t_ns * 1e-9 == pytest.approx(np.asarray(kind.t), abs=1.1e-9)
    told = listed([path])
    assert all(part in told.text() for part in kind.told)
    assert all(part in report.text() for part in kind.reported)
    reasons = {column: why for _, column, why in told.left_out}
    for column, why in kind.left_out.items():
        assert why in reasons[column]
        assert f"not read: {reasons[column]}" in told.text()
