"""What one sees of a run."""

import io

import pytest

from rig.bench.live import status
from rig.bench.live.outcome import Outcome
from rig.bench.live.status import Live
from rig.bench.live.timing import Timing

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
COUNTS = {"taken": 10, "late": 1, "oldest": 2, "held": 0, "overtaken": 0, "clamped": 3, "not_finite": 0, "refused": 0}


@pytest.fixture
def summary():
    timing = Timing(1_000_000)
    timing.rows += [(i * 1_000_000, 40_000, True, 1_000, 20_000, 30_000, 500, i) for i in range(1000)]
    timing.rows.append((1_003_000_000, 3_000_000, True, 1_000, 20_000, 30_000, 500, 1000))
    timing.fold()
    verdict = timing.verdict(0.01, 0.05, {"meas/laser to recorder": 2})
    return {
        "run": "belt-1",
        "verdict": verdict.word,
        "reasons": list(verdict.reasons),
        "exit_code": verdict.exit_code,
        "ended": "done",
        "fault": "",
        "faults": ["controller nf left at t = 0.500 s"],
        "mode": "paced",
        "ticks": 1001,
        "seconds": 1.001,
        "wall_seconds": 1.002,
        "timing": timing.to_json(),
        "waiting": {"spin_ns": 0, "why": "spinning gains nothing"},
        "scheduling": "",
        "memory": "memory is not locked: the limit memlock is 8192 kB; it must be unlimited",
        "round_trip": {"p50": 120.0, "p99": 300.0, "max": 900.0},
        "loop": {"nf": COUNTS, "refused": {"stranger": 4}},
        "lost": {"meas/laser to recorder": 2},
        "unknown": ["recorder second"],
        "energy": {"error": 4e-10},
        "plant": {"method": "dopri5", "events": 20, "stick_share": 0.4},
    }


def test_the_line_fits_a_terminal():
    said = status.line(HEALTH)
    assert said == "hold 3/7 12.4 s rt 1.00 late 0.21 ms drops 0 E 3e-10 stick 41% 27 s left overruns 0 held 2"
    assert said.index(" overruns") < 80
    assert "left" not in status.line({**HEALTH, "eta_s": -1.0})


def test_the_summary_says_verdict_worst_lateness_cause_losses_and_what_next(summary):
    text = Outcome(summary, "run.mcap", "run.mcap: 10 messages, 2 lost", ("the viewer ended with code 2",)).text()
    for said in (
        "DEGRADED: 0.10% of 1001 frames late by more than one frame; worst 3 ms at frame 1000, wake",
        "lost 2 of meas/laser to recorder",
        "unknown losses on the way to recorder second",
        "overruns by cause: 1 wake",
        "nf: 10 commands, 1 late, 3 clamped, oldest 2 frames",
        "stranger: 4 commands refused",
        "time from step to command 0.12 / 0.30 / 0.90 ms (p50, p99, worst)",
        "controller nf left at t = 0.500 s",
        "the viewer ended with code 2",
        "rig report run.mcap | rig verify run.mcap | rig live replay run.mcap",
    ):
        assert said in text


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
