"""Text of unknown origin does not command a terminal, and it can always be written."""

import sys

import pytest

from rig.cli import app, printing
from rig.printable import printable, unprintable

HOSTILE = "pad \x1b]0;title\x07\x1b[31m \x9b2J\r\x7f \udcff ü 漢 👩‍🔧\ttab\nline"


def test_control_characters_become_escapes_and_text_stays():
    shown = printable(HOSTILE)
    assert not unprintable(shown)
    assert all(c in "\t\n" or c.isprintable() or c == "\u200d" for c in shown)
    assert shown.encode()
    assert shown.endswith("ü 漢 👩‍🔧\ttab\nline")
    assert unprintable(HOSTILE) == ["\x1b", "\x07", "\x9b", "\r", "\x7f", "\udcff"]


@pytest.mark.parametrize("shown", [printing.line, printing.note, lambda text: printing.table("", ("text",), [(text,)])])
def test_what_is_printed_is_safe(shown, capfd):
    shown(HOSTILE)
    sys.stdout.flush()
    out, err = capfd.readouterr()
    assert "\\u001b[31m" in out + err
    assert not unprintable(out + err)


def test_an_error_names_a_file_safely(capfd):
    with pytest.raises(SystemExit):
        app.run(["verify", "none\x1b[31m.mcap"])
    assert "none\\u001b[31m.mcap" in capfd.readouterr().err
