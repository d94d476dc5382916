"""The audit of a run: what changed nothing in it, what is missing, judged on its own states."""

from dataclasses import replace

import numpy as np
import pytest

import rig
from rig.bench.run.audit import LEAST
from rig.bench.run.rig_comparison import Comparison, VisitedState
from rig.bench.run.runner import PlantRunner
from rig.cli import app
from rig.errors import RigError
from rig.model.formulation import assemble
from rig.scenes.protocol import STEPS
from rig.scenes.shipped import names, text_of
from rig.scenes.variants import absent, added, declared


def judged(scene, seconds=3.0):
    return {one["effect"]: one for one in rig.simulate(scene, seconds).summary["audit"]}


def test_a_limit_that_was_never_met_is_on_for_nothing_and_a_lag_is_not():
    found = judged(rig.load("pendulum"), None)
    limits, lag = found["load limits"], found["load lag"]
    assert limits["on"]
    assert limits["noted"]
    assert limits["share"] == 0.0
    assert lag["share"] > LEAST
    assert not lag["noted"]


@pytest.mark.parametrize("frame", ["1 ms", "10 ms"])
def test_a_dither_that_is_zero_at_every_even_instant_has_an_influence(frame):
    found = judged(rig.load("belt_dither", {"dither.frequency": "250 Hz", "clock.frame": frame}), 6.0)["dither"]
    assert found["on"]
    assert found["share"] > LEAST


def test_the_share_is_one_of_all_forces():
    """1 % more stiffness: 1 % of the spring's force, beside friction the only one on a mass that rests."""
    scene = rig.load("belt_c")
    system = scene.assemble().system()
    other = rig.load("belt_c", {"body.stiffness": 1.01 * float(system.stiffness[0, 0])}).assemble().system()
    key, x = system.key([0], [0], []), system.start.copy()
    x[:2] = 0.01, 0.0
    friction = float(abs(assemble(system, key).friction[0] @ x))
    spring = float(system.stiffness[0, 0]) * 0.01
    assert Comparison([VisitedState(system, key, x, scene)]).share(lambda _: (other, {})) == pytest.approx(
        0.01 * spring / (1.01 * spring + friction), rel=1e-9
    )


def test_a_switch_that_stayed_open_is_no_effect_that_changes_nothing():
    found = judged(rig.load("belt_shunt", {"shunt.connected": "false"}), 0.5)["shunt"]
    assert found["open"] == "shunt.connected"
    assert found["text"] == 'Effect "shunt" stayed open in this run (shunt.connected closes it)'
    closed = judged(rig.load("belt_shunt"), 0.5)["shunt"]
    assert closed["open"] == ""
    assert not closed["noted"]


def test_a_switch_that_was_closed_for_a_moment_did_not_stay_open():
    steps = [("hold", 0.1), 1.0, ("hold", 0.01), 0.0, ("hold", 0.3)]
    protocol = [
        {"step": "hold", "time": s[1]} if isinstance(s, tuple) else {"step": "set", "target": "dither.enable", "to": s}
        for s in steps
    ]
    found = judged(replace(rig.load("belt_dither"), protocol=STEPS.validate_python(protocol)), None)["dither"]
    assert found["open"] == ""
    assert judged(rig.load("belt_dither"), 0.5)["dither"]["open"] == "dither.enable"


def test_explain_tells_the_audit_of_a_recording(tmp_path, capsys):
    log = tmp_path / "run.mcap"
    for arguments in (["simulate", "pendulum", "--duration", "1", "--out", str(log)], ["explain", str(log)]):
        with pytest.raises(SystemExit) as left:
            app.run(arguments)
        assert not left.value.code
    said = capsys.readouterr().out
    told = 'Effect "load limits" is active but never influenced this run (load stayed within its range)'
    assert " ".join(said.split()).count(told) == 2


def test_a_rig_with_smoothed_friction_is_compared_with_one_alike():
    found = judged(rig.load("belt_b", {"clock.method": "smooth"}), 0.5)
    assert found["drive lag"]["share"] < 1e-9


def test_a_contact_that_opens_for_a_moment_counts():
    """Body 2 lifts off for some of the last milliseconds, in none of the states that are judged."""
    run = rig.simulate("four_dof", 9.4)
    lifted = run.signals["normal_force"] <= 0.0
    found = {one["effect"]: one for one in run.summary["audit"]}["separation"]
    assert 0.0 < lifted.mean() < 0.01
    assert found["share"] == pytest.approx(lifted.mean(), rel=0.2)
    early = judged(rig.load("four_dof"), 3.0)["separation"]
    assert early["share"] == 0.0
    assert early["text"].endswith(f"had no influence on this run, judged at {early['states']} of its states")


HEAVY = {
    *(
        "belt_contact_temperature",
        "belt_dahl",
        "belt_dither",
        "belt_hysteresis",
        "belt_maxwell_slip",
    ),  # kernels of their own
    *("belt_dither_controlled", "belt_faults", "belt_normal_force_acceleration", "belt_normal_force_displacement"),
    *("belt_poor_network", "brake_active", "tip_epoxy"),
    *("brake", "brake_3400", "brake_disc_modes", "brake_shunt", "brake_shunt_listener", "brake_shunt_sound"),
    *("brake_shunt_tuned", "disc_slider", "disc_slider_dither", "lever_three_stage", "disc_slider_a"),
}
BEFORE_IT_RUNS_AWAY = {"disc_slider_a": 0.08}


def moved(scene, target, to, over, hold=1.0):
    """The scene with nothing but a ramp of an actuator, which no controller drives, and a hold."""
    steps = [{"step": "ramp", "target": target, "to": to, "over": over}, {"step": "hold", "time": hold}]
    return replace(scene, protocol=STEPS.validate_python(steps), controllers={})


RISING = {
    "friction.law": "stribeck_viscous",
    "friction.mu_static": 0.3,
    "friction.mu_dynamic": 0.3,
    "friction.viscous": 0.3,
    "friction.speed_scale": 0.05,
    "drive.speed": 0.5,
}
CHANGED = {
    "a slow ramp beyond the limit": lambda: moved(rig.load("belt"), "drive.speed", 0.3, 20.0),
    "a ramp that ends just within it": lambda: moved(rig.load("belt"), "drive.speed", 0.24, 2.0, 3.0),
    "a belt that reverses": lambda: moved(rig.load("belt"), "drive.speed", -0.1, 5.0),
    "another friction and mass": lambda: moved(
        rig.load("belt", {"friction.mu_static": 0.4, "body.mass": 2.0}), "drive.speed", 0.5, 4.0
    ),
    "an absorber": lambda: moved(rig.load("belt_tuned_mass"), "drive.speed", 0.36, 5.0),
    "steady sliding on a belt that accelerates": lambda: moved(
        rig.load("belt", RISING | {"start.displacement": 0.0036, "start.velocity": 0.0, "body.damping": 200.0}),
        "drive.speed",
        2.5,
        5.0,
    ),
    "a creeping contact": lambda: replace(
        rig.load("belt_rate_state"),
        protocol=STEPS.validate_python(
            [
                {"step": "load", "force": 60.0, "over": 0.5},
                {"step": "ramp", "target": "drive.speed", "to": 5e-3, "over": 0.5},
            ]
        ),
    ),
    "bristles on a belt that reverses": lambda: moved(rig.load("belt_lugre"), "drive.speed", -0.06, 1.0),
    "a warm contact": lambda: moved(rig.load("belt_contact_temperature"), "drive.speed", 0.1, 1.0),
    "a load beyond that of the magnet": lambda: moved(
        rig.load("pendulum", {"load.force_max": "none"}), "load.force", 60.0, 5.0
    ),
}


def missing(scene):
    """Effects that an audit judges as absent -> the scene with them."""
    about, found = declared(scene.parameters), {}
    for effect, keys in absent(scene).items():
        try:
            if not about[effect].hardware:
                found[effect] = added(scene, keys)[0]
        except RigError:
            continue
    return found


def difference(run, other):
    """The largest difference of the contact forces of two runs, over the larger one."""
    norm = np.linalg.norm
    names = [name for name in ("friction_force", "normal_force") if name in run.signals]
    pairs = [(run.signals[name], other.signals[name]) for name in names]
    return max((norm(a - b) / max(norm(a), norm(b)) for a, b in pairs), default=0.0)


@pytest.mark.parametrize(
    "name",
    [
        *(
            pytest.param(name, marks=pytest.mark.slow if name in HEAVY else ())
            for name in names()
            if 'kind = "device"' not in text_of(name)  # which needs a board
        ),
        *CHANGED,
    ],
)
def test_the_size_of_an_absent_effect_is_that_of_a_simulation_with_it(name):
    """The reference: the forces of both runs; for limits the time at them in the run with it. Or it is not judged."""
    scene, seconds = CHANGED.get(name, lambda: rig.load(name))(), BEFORE_IT_RUNS_AWAY.get(name)
    lacking = missing(scene)
    if not lacking:
        pytest.skip("its plant has no other effect that is not hardware")
    run = rig.simulate(scene, seconds)
    lines = {line["effect"]: line for line in run.summary["audit"]}
    for effect, with_it in lacking.items():
        line = lines[effect]
        if line["unjudged"]:
            assert "cannot be judged" in line["text"]
            continue
        other = rig.simulate(with_it, seconds)
        at_limit = {one["effect"]: one["share"] for one in other.summary["audit"]}[effect]
        reference = at_limit if effect.endswith(" limits") else difference(run, other)
        size = line["share"]
        assert max(size, reference) < LEAST or 1.0 / 1.5 <= size / reference <= 1.5, (effect, size, reference)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("a creeping contact", "has memory"),
        ("bristles on a belt that reverses", "has memory"),
        ("a warm contact", "has memory"),
        ("a belt that reverses", "stick and slip"),
        ("steady sliding on a belt that accelerates", ""),
    ],
)
def test_what_states_of_a_run_cannot_tell_is_not_judged(name, why):
    """With the lag, paired simulations differ by 0.4, 38, 5, 42 %, where the shares are 126, 96, 0.3, 0.2 %."""
    line = judged(CHANGED[name](), None)["drive lag"]
    assert line["share"] > LEAST
    assert why in line["unjudged"]
    assert bool(line["unjudged"]) == bool(why)


def test_a_lag_that_shifts_an_event_past_a_state_does_not_count_as_the_whole_friction():
    """One state of this ramp is just before it sticks; there the slip with the lag has the other sign."""
    ramp = STEPS.validate_python([{"step": "ramp", "target": "drive.speed", "to": 0.3, "over": 5.0}])
    line, reference = (
        judged(replace(rig.load("belt_dither", values), protocol=ramp), None)["drive lag"]["share"]
        for values in ({}, {"drive.lag": 0.01})
    )
    assert LEAST < reference < 0.01
    assert line == pytest.approx(reference, rel=0.5)


def test_values_changed_during_a_run_are_no_effect():
    """The belt of this scene is stiffened in mid run; a limit that no command meets changes nothing."""
    assert judged(rig.load("belt_remedy_stiffness"), None)["drive limits"]["share"] < 1e-12


@pytest.mark.parametrize(("name", "values"), [("two_dof", {"separation": "none"}), ("disc_slider_c", {})])
def test_a_contact_that_pulls_is_told_with_its_time_and_size(name, values):
    scene = rig.load(name, values)
    run = rig.simulate(scene)
    force = run.signals["normal_force"][1:]
    line = {one["effect"]: one for one in run.summary["audit"]}["separation"]
    assert line["noted"]
    assert line["share"] > 0.1
    assert line["pulled"] == pytest.approx((force < 0.0).mean(), rel=1e-12)
    assert line["pull"] == pytest.approx(-force.min(), rel=1e-12)
    assert f"contact pulled for {line['pulled']:.2%} of the time, with up to {line['pull']:.3g} N" in line["text"]
    live = PlantRunner(scene)
    while live.tick * live.steps < len(force):
        live.frames(1)
    assert live.state_samples.pulled(Comparison(()))["contact"] == (line["pulled"], line["pull"])
