"""The outputs over one period of a limit cycle, and its figure."""

import numpy as np
import pytest
from matplotlib.image import imread

import rig
from rig.analysis.cycle import limit_cycle
from rig.view.palette import put


@pytest.fixture(scope="module", params=["belt", "pin"])
def found(request):
    scene = rig.load(request.param)
    return scene, limit_cycle(scene)


def test_the_outputs_cover_one_period_and_close(found):
    _, cycle = found
    assert cycle.time[0] == 0.0
    assert cycle.time[-1] == pytest.approx(cycle.period, abs=1e-9)  # simulated to the nanosecond
    assert np.all(np.diff(cycle.time) >= -1e-9 * cycle.period)
    for name in ("displacement", "velocity"):
        v = cycle.outputs[name]
        assert v.shape == cycle.time.shape
        assert v[-1] == pytest.approx(v[0], abs=1e-6 * np.ptp(v))


def test_they_stay_within_the_extremes_and_nearly_reach_them(found):
    _, cycle = found
    for name, (low, high) in cycle.extremes.items():
        v, slack = cycle.outputs[name], 1e-9 * max(abs(low), abs(high))
        assert low - slack <= v.min()
        assert v.max() <= high + slack
        assert np.ptp(v) >= 0.99 * (high - low) - slack


def test_velocity_is_the_rate_of_displacement_at_every_smooth_place(found):
    _, cycle = found
    whole = np.trapezoid(cycle.outputs["velocity"], cycle.time)
    assert whole == pytest.approx(0.0, abs=1e-5 * np.ptp(cycle.outputs["displacement"]))


def test_intervals_of_stick_add_up_and_the_contact_moves_with_its_surface_in_them(found):
    _, cycle = found
    assert sum(b - a for a, b in cycle.sticking) == pytest.approx(next(iter(cycle.stick_time.values())), rel=1e-6)
    for begin, end in cycle.sticking:
        inside = (cycle.time > begin + 1e-9) & (cycle.time < end - 1e-9)
        assert inside.any()
        assert cycle.outputs["velocity"][inside] == pytest.approx(cycle.outputs["surface_speed"][inside], abs=1e-9)


def test_the_report_in_json_has_no_thousands_of_numbers(found):
    _, cycle = found
    assert not {"time", "outputs"} & cycle.to_json().keys()


def test_the_figure_is_drawn(found, tmp_path):
    _, cycle = found
    put(cycle.plot(), tmp_path / "cycle.png")
    assert imread(tmp_path / "cycle.png").std() > 0.02


def test_where_nothing_slides_the_figure_tells_the_reason(tmp_path):
    scene = rig.load("belt", {"drive.speed": 0.0})
    cycle = limit_cycle(scene)
    assert not cycle.found
    put(cycle.plot(), tmp_path / "none.svg")
    assert "no surface moves" in (tmp_path / "none.svg").read_text()
