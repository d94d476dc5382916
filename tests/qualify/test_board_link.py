"""The measured link to a board: echo frames that never call its law."""

import json

import pytest
from boards import board_port, on_board, standing_in

from rig.cli import app
from rig.errors import DeviceError
from rig.qualify import board_link
from rig.qualify.board_link import measure


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    monkeypatch.setattr(board_link, "RATES", {100: 10, 1000: 100, 5000: 200})


@pytest.mark.parametrize("kind", ["udp", "serial"])
def test_round_trips_are_measured_and_the_law_is_not_called(kind, tmp_path):
    port = board_port() if kind == "udp" else f"serial:{tmp_path / 'board'}"
    _, law = on_board("belt_normal_force", port)
    with standing_in(port, law) as board:
        measured = measure(port, 115200, "float64", 1)
    assert board.steps == 0
    assert measured.size == (48 if kind == "udp" else 60)
    assert [at.rate for at in measured.rates] == [100, 1000, 5000]
    assert all(0.0 < at.p50 <= at.p99 <= at.worst for at in measured.rates)
    assert sum(at.missed for at in measured.rates) == 0
    assert measured.period_ms >= max(at.p99 for at in measured.rates) / 0.8
    assert f"holds a period of {measured.period_ms:g} ms" in measured.text()


def test_the_command_tells_a_link_in_json(capsys):
    port = board_port()
    _, law = on_board("belt_normal_force", port)
    with standing_in(port, law), pytest.raises(SystemExit) as ended:
        app.run(["tool", "device", port, "--json"])
    out = capsys.readouterr().out
    told = json.loads(out[out.index("{") :])
    assert not ended.value.code
    assert told["rates"][0]["frames"] == 10


def test_answers_that_never_come_are_missed_and_a_timer_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(board_link, "PATIENCE_S", 0.05)
    port = f"serial:{tmp_path / 'board'}"
    _, law = on_board("belt_normal_force", port)
    with standing_in(port, law, "missing", every=10):
        adapter = tmp_path / (tmp_path / "board").resolve().name
        adapter.mkdir()
        (adapter / "latency_timer").write_text("16\n")
        monkeypatch.setattr(board_link, "LATENCY", tmp_path)
        measured = measure(port, 115200, "float64", 1)
    assert 10 <= measured.rates[1].missed < 50  # a busy machine is late with others, too
    assert measured.period_ms is None
    assert f"for 16 ms; shorter: echo 1 | sudo tee {adapter}/latency_timer" in measured.text()


def test_a_silent_or_wrong_port_is_refused(monkeypatch):
    monkeypatch.setattr("rig.machine.board.BOOT_S", 0.1)
    with pytest.raises(DeviceError, match="no answer within"):
        measure(board_port(), 115200, "float64", 1)
    with pytest.raises(DeviceError, match="COM3: expected"):
        measure("COM3", 115200, "float64", 1)
