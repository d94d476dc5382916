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
    "plant": (),
    "cycle": (),
    "map": ("--x", "drive.speed=0.1:0.2:2"),
    "cost": (),
    "modes": ("--sweep", "drive.speed=0.1:0.2:2"),
}
WORKERS = ("rig.bench.supervise.run", "rig.bench.status.Live", "rig.qualify.cost.cost", "rig.analysis.map.job")


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("delta", [-0.9, -0.8])
def test_a_capacitance_within_a_tenth_of_its_limit_is_warned_of(command, delta, capsys, monkeypatch):
    """The limit is -k_b/(k_b + kappa) = -1000/1050: a tenth more than -0.9 is beyond it, not so of -0.8."""

    def stop(*given, **named):
        raise UsageError(STOPPED)

    for worker in WORKERS:
        monkeypatch.setattr(worker, stop)
    with pytest.raises(SystemExit):
        app.run([command, "belt_shunt", "-p", f"shunt.delta={delta}", *COMMANDS[command]])
    said = capsys.readouterr().err
    assert said.count(WARNING) == (delta == -0.9)
    assert (STOPPED in said) is (command in ("run", "plant", "map", "cost"))
