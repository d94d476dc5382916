"""Progress of long commands where standard error is no terminal."""

from rig.cli import printing


def test_without_a_terminal_progress_is_a_line_now_and_then(capsys, monkeypatch):
    clock = iter([0.0, 1.0, 5.5, 5.5, 6.0, 11.0, 11.0])
    monkeypatch.setattr(printing.time, "monotonic", lambda: next(clock))
    with printing.bar("rows") as show:
        for done in range(1, 5):
            show(done, 40)
    assert capsys.readouterr() == ("", "rows: 2 of 40\nrows: 4 of 40\n")


def test_short_work_prints_no_progress(capsys):
    with printing.bar("rows") as show:
        show(1, 1)
    assert capsys.readouterr() == ("", "")
