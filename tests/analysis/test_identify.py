"""Identification experiments give back the scene's own parameters from noisy sensors; how vibration is measured."""

import json

import numpy as np
import pytest

import rig
from rig.analysis.identification.lever import experiment
from rig.analysis.recorded import amplitude
from rig.analysis.recorded.stick_speeds import stages
from rig.cli import printing
from rig.errors import UsageError
from rig.record.run import Run, Samples
from rig.solve.records import CLOSED, SLIP_PLUS, STICK

EXPERIMENTS = {
    "lever_free_cylinder": {"cylinder.inertia": 0.035, "cylinder.damping": 0.12},
    "lever_free_lever": {"lever.inertia": 0.0025, "lever.damping": 0.01},
    "lever_static_friction": {"friction.mu_static": 0.42},
    "lever_kinetic_friction": {"friction.mu_static": 0.42, "friction.mu_kinetic": 0.3, "friction.decay": 220.0},
}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_an_experiment_gives_back_the_parameters_of_its_scene(name):
    result = experiment(rig.load(name))
    assert {one.key: one.stated for one in result.parameters} == EXPERIMENTS[name]
    for one in result.parameters:
        assert one.value == pytest.approx(EXPERIMENTS[name][one.key], rel=0.01), one.key
        assert one.value != one.stated
        assert one.verdict == "identified"
        assert one.low < one.value < one.high


def test_the_command_draws_the_fit_and_writes_a_page(rig, tmp_path):
    path, page = tmp_path / "fit.svg", tmp_path / "fit.html"
    code, out, _ = rig("identify", "lever_static_friction", "--figure", path, "--page", page, "--json")
    assert code == 0
    assert (json.loads(out)["figure"], json.loads(out)["page"]) == (str(path), str(page))
    assert path.read_text().startswith("<?xml")
    assert "identified</td>" in page.read_text()
    assert "data:image/png" in page.read_text()


def test_a_next_experiment_that_cannot_be_proposed_leaves_the_report(rig, tmp_path):
    assert rig("simulate", "lever_free_cylinder", "--out", tmp_path / "free.mcap")[0] == 0
    (tmp_path / "runs.toml").write_text(
        '[free]\n"cylinder.damping" = "0.01:1 N*m*s"\n[[run]]\nfile = "free.mcap"\nkind = "growth"\n'
        '[run.columns]\narm_laser = {reads = "arm_displacement"}\n'
    )
    given = ("--runs", tmp_path / "runs.toml", "--folder", tmp_path / "fits", "--workers", "1")
    code, out, err = rig("identify", "lever_free_cylinder", *given, "--next", "cylinder.inertia=0.03, 0.04")
    assert code == 2
    assert "cylinder.damping" in out
    assert "this is done for runs of cycles only" in err


def test_progress_says_how_many_cycles_are_usual_and_what_time_is_left(monkeypatch):
    now = 100.0
    monkeypatch.setattr(printing.time, "monotonic", lambda: now)
    words = printing.about("cycles", 100)
    assert words(20) == "20 of about 100 cycles computed"  # kept from before
    now = 150.0
    assert words(21) == "21 of about 100 cycles computed"  # kernels were compiled
    now = 160.0
    assert words(31) == "31 of about 100 cycles computed, about 69 s left"
    assert words(120) == "120 cycles computed; usual are 100"


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ("drive.sped=0.1, 0.2", "drive.speed"),
        ("drive.speed=1 kg", "drive.speed"),
        ("drive.speed=uniform(0.1, 0.2)", "no distribution"),
        ("dither.amplitude=0.1, 0.2", "dither"),
    ],
)
def test_settings_of_a_next_experiment_are_read_before_the_fit(rig, tmp_path, settings, words):
    """No recording is opened: there is none."""
    given = ("--runs", tmp_path / "runs.toml", "--folder", tmp_path / "fits", "--next", settings)
    code, out, err = rig("identify", "belt", *given)
    assert (code, out) == (2, "")
    assert words in err
    assert "runs.toml" not in err


def test_a_whole_rig_is_no_experiment():
    with pytest.raises(UsageError, match="is not an identification experiment"):
        experiment(rig.load("lever"))
    with pytest.raises(UsageError, match="give recordings: --runs FILE"):
        experiment(rig.load("belt"))
    coulomb = {"friction.law": "coulomb", "friction.mu_static": 0.4, "friction.mu_kinetic": 0.3}
    with pytest.raises(UsageError, match="only the exponential law can be fitted"):
        experiment(rig.load("lever_kinetic_friction", coulomb))


def test_amplitude_index_of_the_lever_as_its_lasers_see_it():
    """Against the limit cycle; the lasers take the mean over 10 ms, of a motion with 2.87 cycles a second."""
    run = rig.simulate("lever", 9.0)
    cycle = rig.limit_cycle("lever")
    for sensor, output in (("arm_laser", "arm_displacement"), ("lever_laser", "lever_displacement")):
        samples = run.measurements[sensor]
        late = samples.t_ns > 4e9
        found = amplitude.index(samples.t_ns[late] * 1e-9, samples.v[late])
        low, high = cycle.extremes[output]
        assert found.half == pytest.approx(0.5 * (high - low), rel=0.02)
        assert found.frequency == pytest.approx(cycle.frequency, rel=0.005)


def recorded(speed, stuck, velocity):
    """A run of the belt with a vibrometer at 1 kHz, and marks at 1 and 2 s."""
    n = len(speed)
    t_ns = np.arange(n) * 1_000_000
    marks = [
        {"t_ns": t * 1_000_000_000, "source": "plant", "kind": "mark", "text": text}
        for t, text in ((1, "hold"), (2, "stop"))
    ]
    system = rig.load("belt").assemble().system()
    keys = {mode: system.key([mode], [CLOSED], [], []) for mode in (STICK, SLIP_PLUS)}
    return Run(
        scene=rig.load("belt").to_json(),
        step_ns=1_000_000,
        frame_ns=1_000_000,
        time=t_ns * 1e-9,
        signals={"surface_speed": speed},
        units={"surface_speed": "m/s", "meas/vibrometer": "m/s"},
        measurements={"vibrometer": Samples(t_ns, velocity)},
        events=marks,
        mode=np.where(stuck, keys[STICK], keys[SLIP_PLUS]),
    )


def test_amplitude_and_last_stick_of_each_stage():
    t = np.arange(3001) * 1e-3
    speed = np.minimum(np.minimum(t, 1.0), 3.0 - t)
    size = np.where(t < 1.0, 0.1, np.where(t < 2.0, 0.2, 0.4))
    run = recorded(speed, (t < 0.6) | (t > 2.7), size * np.sin(2.0 * np.pi * 20.0 * t))
    rows = {row.stage: row for row in amplitude.measured(run)}
    assert [row.found.half for row in rows.values()] == pytest.approx([0.1, 0.2, 0.4], rel=1e-2)
    assert list(rows) == ["before", "hold", "stop"]
    assert all(row.found.frequency == pytest.approx(20.0, rel=1e-3) for row in rows.values())
    found = stages(run)
    assert (found.up, found.down) == pytest.approx((0.599, 0.299))
    assert (
        found.text() == "last stick while the drive accelerates: 0.599 m/s; first stick while it decelerates: 0.299 m/s"
    )
    late = list(amplitude.measured(run, first=1.2, last=1.8))
    assert [row.stage for row in late] == ["hold"]
    assert late[0].found.cycles == 10  # twelve periods; the first begins in its middle, the last is cut off


def test_what_a_cut_recording_lost_of_speed_and_contact_modes_counts_for_no_stage():
    t = np.arange(3001) * 1e-3
    speed = np.minimum(np.minimum(t, 1.0), 3.0 - t)
    run = recorded(speed, (t < 0.6) | (t > 2.7), np.sin(t))
    whole = stages(run)
    run.signals["surface_speed"][2900:] = np.nan
    run.mode[2950:] = -1
    assert stages(run) == whole
    run.mode[2650:] = -1
    assert stages(run).up == whole.up
    assert np.isnan(stages(run).down)
    run.signals["surface_speed"][:] = np.nan
    assert stages(run) is None
    for speed in (np.ones(t.size), t):  # it does not accelerate, or not decelerate again
        assert stages(recorded(speed, t < 1.0, np.sin(t))) is None
