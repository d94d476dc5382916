"""Text of unknown origin does not command a terminal, and it can always be written."""

import sys

import pytest

from rig.cli import app, printing
from rig.printable import unprintable

HOSTILE = "pad \x1b]0;title\x07\x1b[31m \x9b2J\r\x7f \udcff ü 漢 👩‍🔧\ttab\nline"


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
