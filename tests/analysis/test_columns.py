"""Tables as text."""

from rig.printable import columns


def test_columns_never_run_into_each_other():
    long = "0.000123457 m/s, 0.207944 m/s, 0.675 m/s"
    lines = list(columns([("key", "onset", "end"), ("1 N", long, "2"), ("100000 N", "-", "3.5")], "<<>"))
    assert lines[0].index("onset") == lines[1].index(long) == lines[2].index("-")
    assert {len(line) for line in lines} == {2 + 8 + 2 + len(long) + 2 + 3}
    assert lines[1].endswith(f"{long}    2")
