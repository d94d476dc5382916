"""Every command that builds the rig of a scene gives the same warnings."""

import pytest

from rig.cli import app
from rig.errors import UsageError

WARNING = (
    "warning: shunt: a stack 10% above its capacitance makes delta -0.9 to -0.990; "
    "the limit is -k_b/(k_b + kappa) = -0.9524 (k_b 1000 N/m, kappa 50 N/m)\n  delta above -0.86\n"
)
STOPPED = "no further in this test"
COMMANDS = {
    "simulate": ("--duration", "0.01"),
    "run": (),
    "live plant": (),
    "map": ("--x", "drive.speed=0.1:0.2:2"),
    "modes": ("--sweep", "drive.speed=0.1:0.2:2"),
}
WORKERS = ("rig.bench.live.supervise.run", "rig.bench.live.status.Live", "rig.analysis.map.job")


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("delta", [-0.9, -0.8])
def test_a_capacitance_within_a_tenth_of_its_limit_is_warned_of(command, delta, capsys, monkeypatch):
    """The limit is -k_b/(k_b + kappa) = -1000/1050: a tenth more than -0.9 is beyond it, not so of -0.8."""

    def stop(*given, **named):
        raise UsageError(STOPPED)

    for worker in WORKERS:
        monkeypatch.setattr(worker, stop)
    with pytest.raises(SystemExit):
        app.run([*command.split(), "belt_shunt", "-p", f"shunt.delta={delta}", *COMMANDS[command]])
    said = capsys.readouterr().err
    assert said.count(WARNING) == (delta == -0.9)
    assert (STOPPED in said) is (command in ("run", "live plant", "map"))


IDLE = "has no effect: {0} is off at the start of {1} ({0}.{2} = false)\n  add -p {0}.{2}=true\n"
SHUNT = ("brake_shunt", "shunt", "connected", "shunt.resistance=5 ohm:50 ohm:2")


@pytest.mark.parametrize(
    ("command", "scene", "effect", "switch", "over", "more"),
    [
        ("modes", *SHUNT, ()),
        ("map", *SHUNT, ()),
        (
            "map",
            "belt_dither",
            "dither",
            "enable",
            "dither.amplitude=0.02:0.1:2",
            ("--y=drive.speed=0.05:0.1:2", "--eigenvalues"),
        ),
        ("study", *SHUNT, ("--measure=cycle.period",)),
        ("optimise", *SHUNT[:-1], "shunt.resistance=5 ohm:50 ohm", ("--minimise=motion.rms",)),
    ],
)
def test_a_parameter_of_an_effect_that_is_off_is_warned_of(
    command, scene, effect, switch, over, more, capsys, monkeypatch, tmp_path
):
    def stop(*given, **named):
        raise UsageError(STOPPED)

    for worker in ("linear.sweep.sweep", "map.chart", "studies.study", "studies.search.search"):
        monkeypatch.setattr(f"rig.analysis.{worker}", stop)
    where = () if command == "modes" else (f"--out={tmp_path}",)
    axis = {"modes": "--sweep", "map": "--x"}.get(command, "--over")
    for changes, warned in (((), 1), (("-p", f"{effect}.{switch}=true"), 0)):
        with pytest.raises(SystemExit):
            app.run([command, scene, axis, over, *more, *changes, *where])
        said = capsys.readouterr().err
        assert said.count(IDLE.format(effect, scene, switch)) == warned
        assert STOPPED in said


def test_a_map_over_the_amplitude_of_a_dither_alone_is_refused(capsys):
    with pytest.raises(SystemExit):
        app.run(["map", "belt_dither", "--x", "dither.amplitude=0.02:0.1:2"])
    assert "over dither a map shows its boundary, with x dither.frequency" in capsys.readouterr().err
