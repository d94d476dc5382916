"""The piezo stack and its shunts: force and dissipation over frequency, switching, ledger, degenerate values.

Numbers: Kroeger, Neubauer, Popp (2008), equations 4.14 to 4.19, with calibrated parameters, by independent code
(tests/reference/kroger_shunt.json).
"""

import math

import numpy as np
import pytest
from reference import numbers

import rig
from rig.bench.run.runner import PlantRunner
from rig.errors import SceneError
from rig.plants import belt
from rig.stability.linearisation import sliding_key, steady

ORACLE = numbers("kroger_shunt")
CPS, E_N_PER_V, XHAT = (ORACLE["cycle"][key] for key in ("Cps", "e", "xhat"))
KAPPA = E_N_PER_V**2 / CPS
RESONANCE = 2.0 * math.pi * ORACLE["f_res"]
STACK = {"piezo.capacitance": CPS, "piezo.coupling": E_N_PER_V}
FREE = {"friction.mu_static": 0.0, "friction.mu_kinetic": 0.0, "start.velocity": 0.0, "start.displacement": 1e-3}
LONE = {"resistance": 0.0, "inductance": 0.0, "delta": 0.0}
SWITCHED = {"shunt.connected": "held"}
COMPILED_WITH = ("R", "RC", "saturated RC", "leak", "bleed")  # a switch more: as many states as other tests have


def shunt(**values):
    return {f"shunt.{key}": value for key, value in values.items()}


def coil(delta):
    """Inductance that puts the resonance of the loop at 3400 Hz."""
    return (1.0 + delta) / (CPS * RESONANCE**2)


def formula(delta, R, omega):
    """G of equation 4.17 for the shunt tuned to 3400 Hz."""
    s, L = 1j * omega, coil(delta)
    return (L * s**2 + R * s + delta / CPS) / (L * s**2 + R * s + (1.0 + delta) / CPS)


def transfer(system, omega):
    """G = F/(kappa dx) from the assembled matrices: the network driven by the motion of the mass."""
    at = steady(system, sliding_key(system))
    nq, first = len(system.coordinates), system.one
    q, v, net = slice(0, nq), slice(nq, 2 * nq), slice(2 * nq, first)
    A, s = at.modes.A, 1j * omega
    driven = A[net, q] + s * A[net, v]
    states = np.linalg.solve(s * np.eye(first - 2 * nq) - A[net, net], driven)
    return complex((-system.coupling[0, q] - system.coupling[0, net] @ states)[0]) / KAPPA


def on_the_stack(delta, R, **changes):
    return rig.load("belt_shunt", STACK | shunt(resistance=R, inductance=coil(delta), delta=delta) | changes)


@pytest.mark.parametrize("R", [25.0, 100.0])
@pytest.mark.parametrize("delta", [0.0, -0.5, -0.8, -0.9])
def test_force_and_dissipation_over_frequency_are_those_of_the_reference(R, delta):
    peak = formula(0.0, R, RESONANCE)
    system = on_the_stack(delta, R).assemble().system()
    for eta, amplitude, phase, heat in ORACLE["table"][f"R{R:g}"][str(delta)]:
        G = transfer(system, eta * RESONANCE)
        assert pytest.approx(formula(delta, R, eta * RESONANCE), rel=1e-10) == G
        assert abs(G) / abs(peak) == pytest.approx(amplitude, rel=1e-4)
        assert math.degrees(math.atan2(G.imag, G.real)) == pytest.approx(phase, abs=1e-4 * 180.0)
        assert G.imag / peak.imag == pytest.approx(heat, rel=1e-4)


def shaken(move, delta, R, eta, settle):
    """The stack stuck to a belt that vibrates, x = xhat sin(omega t), for `settle` s; then the motion goes on."""
    hertz = eta * ORACLE["f_res"]
    speed = XHAT * 2.0 * math.pi * hertz
    changes = STACK | shunt(resistance=R, inductance=coil(delta), delta=delta)
    changes |= {"drive.speed": 0.0, "friction.mu_static": 1e9, "load.force": 1e3, "start.velocity": speed}
    changes |= {
        "dither.on": "belt",
        "dither.amplitude": speed,
        "dither.frequency": hertz,
        "dither.phase": 0.5 * math.pi,
    }
    return move("belt_shunt", changes, 0.05, settle)


@pytest.mark.parametrize("row", ORACLE["cycle"]["rows"], ids=lambda row: f"{row['delta']:g} {row['eta']:g}")
def test_dissipation_per_cycle_from_simulation(move, row):
    """Over a whole number of cycles that is a whole number of ticks, from the ledger of the run, to 1e-8."""
    delta, R, eta = row["delta"], row["R"], row["eta"]
    hertz = round(eta * ORACLE["f_res"])
    cycles = hertz // math.gcd(hertz, 20)
    run = shaken(move, delta, R, eta, 0.25)
    before = run.motion.energy()["resistor"]
    run.motion.advance(round(cycles / hertz * 20000))
    heat = (run.motion.energy()["resistor"] - before) / cycles
    theory = math.pi * XHAT**2 * KAPPA * formula(delta, R, eta * RESONANCE).imag
    assert heat == pytest.approx(theory, rel=1e-8)
    assert heat == pytest.approx(row["E_formula"], rel=1e-8)
    assert abs(run.motion.energy()["error"]) < 1e-9
    force, x = -E_N_PER_V * run["stack_voltage"], run["displacement"]
    v = run["velocity"] / (2.0 * math.pi * hertz)
    G = complex(force @ x, force @ v) / (0.5 * len(x) * XHAT**2 * KAPPA)
    assert pytest.approx(formula(delta, R, eta * RESONANCE), rel=1e-6) == G


KINDS = {
    "R": shunt(resistance=2e3, inductance=0.0, delta=0.0),
    "LR": shunt(resistance=50.0, inductance=1.0, delta=0.0),
    "LRC": shunt(resistance=50.0, inductance=1.0, delta=-0.9),
    "RC": shunt(resistance=2e3, inductance=0.0, delta=0.7),
    "leak": shunt(resistance=50.0, inductance=1.0, delta=-0.5, leak=1e5),
    "bleed": shunt(resistance=50.0, inductance=1.0, delta=-0.5, leak=1e5, bleed=2e5),
    "bled capacitor": shunt(resistance=50.0, inductance=0.0, delta=0.5, bleed=2e5),
    "saturated": shunt(resistance=50.0, inductance=1.0, delta=-0.8, saturation=12.0),
    "saturated RC": shunt(resistance=2e3, inductance=0.0, delta=-0.8, saturation=12.0),
    "parallel": {"shunt.kind": "parallel", "shunt.resistance": 2e3, "shunt.inductance": 5.0, "shunt.ratio": -0.5},
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_passive_rig_loses_what_its_resistors_take(move, kind):
    """No friction: the energy falls by the heat of damper and resistors, and by nothing else."""
    run = move("belt_shunt", FREE | KINDS[kind], 0.2, 0.4, moved=SWITCHED if kind in COMPILED_WITH else None)
    system, x = run.motion.system, run.motion.states
    energy = run.motion.energy()
    assert abs(energy["error"]) < 1e-9
    assert energy["drive"] == energy["switch"] == 0.0
    stored = run.motion.energy()["stored"]
    assert stored == pytest.approx(-energy["damper"] - energy["resistor"], abs=1e-9 * energy["damper"])
    rates = x[1:] - x[:-1]
    assert np.isfinite(rates).all()
    assert energy["resistor"] != 0.0
    if kind in ("LR", "LRC"):
        i = x[:, system.names.index("shunt.current")]
        assert energy["resistor"] == pytest.approx(50.0 * np.trapezoid(i**2, dx=2e-4), rel=1e-3)
    if kind.startswith("saturated"):
        assert {"op-amp clamps high", "op-amp unclamps"} <= {e.what for e in run.motion.events()}


def test_the_op_amp_gives_no_more_than_its_voltage(move):
    run = move("belt_shunt", FREE | KINDS["saturated"], 0.02, 0.1)
    shown = run["capacitor_voltage"]
    assert np.abs(shown).max() == 12.0
    assert run.motion.system.describe(run.motion.key).endswith("op-amp high")
    assert abs(run.motion.energy()["error"]) < 1e-9  # with what the clamped capacitor stores
    U, i = run["stack_voltage"], run["shunt_current"]
    slope = np.gradient(i, 2e-5)[1:-1]
    expected = (-U - 50.0 * i - shown)[1:-1]
    assert slope == pytest.approx(expected, abs=3e-3 * np.abs(slope).max())  # a kink between samples


@pytest.mark.parametrize("kept", [{}, {"resistance": 2e3}, {"inductance": 1.0}, {"delta": -0.5}, LONE])
def test_small_values_come_to_what_none_is(kept):
    """R -> 0, L -> 0 and both: the eigenvalues of structure go over into those without, the states are gone."""

    def least(**values):
        changes = STACK | {"piezo.coupling": 1e-3} | shunt(**{**LONE, **kept, **values})
        system = belt.assemble(rig.load("belt_shunt", FREE | changes).parameters, {}).system()
        at = steady(system, sliding_key(system)).eigenvalues()
        return complex(at[np.argmin(np.abs(at - 31.6j))]), [name for name in system.names if name.startswith("shunt")]

    gone = {"resistance", "inductance"} - kept.keys() if kept is not LONE else {"resistance", "inductance"}
    none, states = least()
    for size in (1e-9, 1e-14):
        small, same = least(**dict.fromkeys(gone, size))
        assert same == states
        assert small == pytest.approx(none, rel=1e-7)
    assert len(states) == ("inductance" not in gone) + (len(gone) < 2)
    for size, bound in ((1.0, 1e-4), (0.1, 1e-5)):
        assert least(**dict.fromkeys(gone, size))[0] == pytest.approx(none, rel=bound)


def runner(**changes):
    return PlantRunner(rig.load("belt_shunt", STACK | {"piezo.coupling": 1e-3} | changes))


def read(on, *names):
    return [on.output(name) for name in names]


def run_for(on, frames):
    for _ in range(frames):
        on.frame()


@pytest.mark.parametrize("delta", [0.0, -0.5])
def test_switching_keeps_the_charges_and_books_the_interrupted_current(delta):
    on = runner(**shunt(delta=delta, resistance=300.0, inductance=20.0))
    run_for(on, 500)
    for _ in range(3):
        before = on.motion.energy()
        x, voltage, current = read(on, "stack_extension", "stack_voltage", "shunt_current")
        assert current != 0.0
        on.apply("shunt.connected", 0.0)
        on.motion.advance(0)
        assert read(on, "stack_extension", "stack_voltage", "shunt_current") == [x, voltage, 0.0]
        lost = on.motion.energy()["switch"] - before["switch"]
        assert lost == pytest.approx(0.5 * 20.0 * current**2, rel=1e-9)
        held = CPS * voltage + 1e-3 * x
        run_for(on, 57)
        x, voltage, current = read(on, "stack_extension", "stack_voltage", "shunt_current")
        assert current == 0.0
        assert CPS * voltage + 1e-3 * x == pytest.approx(held, rel=1e-12)
        on.apply("shunt.connected", 1.0)
        on.motion.advance(0)
        assert read(on, "stack_extension", "stack_voltage", "shunt_current") == [x, voltage, 0.0]
        run_for(on, 91)
        assert on.output("shunt_current") != 0.0
    assert abs(on.motion.energy()["error"]) < 1e-9


def now(run, name):
    """An output of a motion at this instant."""
    return float(run.motion.outputs_now()[run.names.index(name)])


def test_a_bled_stack_is_connected_again_with_another_offset(move):
    """Stack and capacitor lose their charges at different rates: what is connected again differs from before."""
    values = (
        STACK | {"piezo.coupling": 1e-3} | shunt(delta=-0.5, resistance=300.0, inductance=20.0, leak=1e6, bleed=5e5)
    )
    run = move("belt_shunt", values, 1.0, 0.5, moved=SWITCHED)
    motion = run.motion
    offset = motion.system.names.index("shunt.offset")
    run.write("shunt.position", 0.0)
    motion.advance(0)
    capacitor, before = now(run, "capacitor_voltage"), motion.x[offset]
    motion.advance(30)
    assert now(run, "capacitor_voltage") == pytest.approx(capacitor * math.exp(-0.5 * 0.03 / (5e5 * CPS)), rel=1e-9)
    assert abs(motion.x[offset] - before) > 0.1 * abs(capacitor)
    voltages = [now(run, name) for name in ("stack_voltage", "capacitor_voltage")]
    run.write("shunt.position", 1.0)
    motion.advance(0)
    assert [now(run, name) for name in ("stack_voltage", "capacitor_voltage")] == voltages
    motion.advance(300)
    assert abs(motion.energy()["error"]) < 1e-9


def test_a_shorted_stack_loses_its_charge_at_once_and_that_is_booked(move):
    run = move("belt_shunt", STACK | {"piezo.coupling": 1e-3} | shunt(**LONE), 1.0, 0.1, moved=SWITCHED)
    assert now(run, "stack_voltage") == 0.0
    run.write("shunt.position", 0.0)
    run.motion.advance(100)
    voltage = now(run, "stack_voltage")
    assert voltage != 0.0
    run.write("shunt.position", 1.0)
    run.motion.advance(100)
    assert run.motion.energy()["switch"] == pytest.approx(0.5 * CPS * voltage**2, rel=1e-9)
    assert abs(run.motion.energy()["error"]) < 1e-9


def test_a_bank_of_coils_is_switched_like_everything_else():
    bank = (15.0, 20.0, 30.0)
    on = runner(**shunt(delta=-0.5, resistance=300.0, inductance=20.0, bank=bank))
    run_for(on, 400)
    before, current = on.motion.energy()["switch"], on.output("shunt_current")
    mode_sets = on.motion.mode_sets
    on.apply("shunt.inductance", 28.0)  # the nearest is 30
    on.motion.advance(0)
    assert on.output("shunt_current") == current
    assert on.motion.energy()["switch"] - before == pytest.approx(0.5 * (20.0 - 30.0) * current**2, rel=1e-9)
    assert "shunt 30 H" in on.mode
    run_for(on, 100)
    on.apply("shunt.connected", 0.0)
    run_for(on, 100)
    on.apply("shunt.inductance", 15.0)
    run_for(on, 10)
    assert "shunt open" in on.mode
    on.apply("shunt.connected", 1.0)
    run_for(on, 100)
    assert "shunt 15 H" in on.mode
    assert on.motion.mode_sets is mode_sets
    assert abs(on.motion.energy()["error"]) < 1e-9


def test_tuning_the_capacitance_keeps_the_charge():
    on = runner(**shunt(delta=-0.5, resistance=300.0, inductance=20.0))
    run_for(on, 400)
    x, voltage, current = read(on, "stack_extension", "stack_voltage", "shunt_current")
    for key, value in (("shunt.delta", -0.7), ("shunt.inductance", 12.0), ("shunt.resistance", 100.0)):
        on.apply(key, value)
        on.motion.advance(0)
        assert on.output("stack_extension") == x
        assert on.output("stack_voltage") == pytest.approx(voltage, rel=1e-12)
        assert on.output("shunt_current") == pytest.approx(current, rel=1e-12)
    run_for(on, 400)
    assert abs(on.motion.energy()["error"]) < 1e-9


def test_an_amplifier_pulls_with_its_voltage():
    changes = STACK | {"amplifier.voltage": 20.0, "amplifier.limit": 50.0}
    system = rig.load("belt_c", FREE | changes).assemble().system()
    assert steady(system, sliding_key(system)).x[0] == pytest.approx(E_N_PER_V * 20.0 / 2500.0, rel=1e-12)


def errors(**values):
    return PlantRunner(rig.load("belt_shunt", shunt(**values) | {"clock.unstable": "run"})).findings


def test_the_time_constant_of_a_network_may_be_tiny_but_not_next_to_nothing():
    run = rig.simulate(rig.load("belt_shunt", {"shunt.resistance": 1e4}), 0.2)  # L/R = 0.02 us, with its sensors
    assert run.signals["displacement"].max() == pytest.approx(5.23701551994e-3, rel=1e-11)
    assert abs(run.energy["error"]) < 1e-9
    with pytest.raises(SceneError, match="too fast for the step in contact"):
        PlantRunner(rig.load("belt_shunt", {"shunt.resistance": 1e15}))


def test_the_static_limit_is_that_of_the_structure():
    limit = -1.0 / 1.05  # kappa is 5 % of the spring
    at = [f for f in errors(delta=-0.96) if f.level == "error"]
    assert any(f"{limit:.4f}" in f.what and "delta above -0.9523, -0.86 to be safe" in f.remedy for f in at)
    assert not [f for f in errors(delta=limit + 1e-6) if f.level == "error"]
    assert [f for f in errors(delta=limit - 1e-6) if f.level == "error"]
    assert [f for f in errors(delta=-0.9) if f.level == "warning" and "10%" in f.what]
    assert not [f for f in errors(delta=-0.9523) if f.level == "error"]
    assert not [f for f in errors(delta=-0.86) if f.level in ("warning", "error") and "delta" in f.what]
    assert not [f for f in errors(delta=-0.8) if f.level == "warning"]
    assert [f for f in errors() if f.level == "info" and "3400 Hz" in f.what]
    with pytest.raises(SceneError, match="is statically unstable"):
        PlantRunner(rig.load("belt_shunt", shunt(delta=-1.05)))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (shunt(delta=-1.0), "leaves the loop without capacitance"),
        (shunt(delta=0.0, saturation=12.0), "with delta 0 there is no capacitor"),
        ({"piezo": "none"}, "needs a stack"),
    ],
)
def test_bad_values_are_told(changes, told):
    with pytest.raises(SceneError, match=told):
        rig.load("belt_shunt", changes)
