"""What one sees of a run."""

import io

from rig.bench.live import status
from rig.bench.live.status import Live

HEALTH = dict.fromkeys(("late", "overruns", "drops"), 0) | {
    "phase": "hold 3/7",
    "t": 12.4,
    "rate": 1.0004,
    "lateness_us": 210.0,
    "worst_us": 900.0,
    "held": 2,
    "energy_error": 3e-10,
    "stick_share": 0.41,
    "eta_s": 27.2,
}


def test_the_line_fits_a_terminal():
    said = status.line(HEALTH)
    assert said == "hold 3/7 12.4 s rt 1.00 late 0.21 ms drops 0 E 3e-10 stick 41% 27 s left overruns 0 held 2"
    assert said.index(" overruns") < 80
    assert "left" not in status.line({**HEALTH, "eta_s": -1.0})


def test_the_live_line_stays_in_its_place_and_lines_stay_above():
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    stream = Terminal()
    live = Live(stream)
    live.show(HEALTH)
    live.say("mark: here")
    live.show({**HEALTH, "phase": "done"})
    live.done()
    written = stream.getvalue()
    assert written.count("\n") == 1
    assert written.index("hold 3/7") < written.index("mark: here") < written.index("done")
    assert written.endswith("\r")
