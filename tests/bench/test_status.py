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


def test_wrong_frames_are_told_by_kind():
    counts = {"frames": 1, "damaged": 2, "other": 0, "unfit": 1, "lost": 3}
    assert status.stream("udp:h:1", counts) == (
        "udp:h:1: 1 frame taken in, 2 frames damaged, 1 frame with other values, lost 3 times"
    )
    counts = {"held": 0, "refused": 0, "missed": 2, "again": 0, "damaged": 1, "other": 4, "unfit": 0, "resets": 1}
    assert status.unanswered(counts) == [
        "2 steps without an answer of the board",
        "1 frame damaged",
        "4 frames late, doubled or foreign",
        "1 reset of the board",
    ]
