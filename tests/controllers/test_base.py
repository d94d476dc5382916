import pytest

from rig import controllers
from rig.controllers.blocks.base import Controller, gets_every_sample, retune
from rig.controllers.blocks.compiled import CompiledSection
from rig.controllers.normal_force import NormalForce
from rig.errors import UsageError

SECTIONS = {
    "normal_force": {"sensor": "v", "gain": "0.2 N*s/mm", "nominal": 20.0},
    "belt_velocity": {"sensor": "v", "gain": 2.0, "nominal": "60 mm/s"},
    "dither": {"sensor": "v", "speed": 0.06, "frequency": "150 Hz"},
    "dither_sampled": {"amplitude": 0.1, "nominal": 0.06},
    "lti": {"A": [[0.5]], "B": [[1.0]], "C": [[2.0]], "D": [[0.0]], "reads": ["v"], "drives": ["load.force"]},
    "narrow_band": {"sensor": "v", "frequency": "2.14 kHz", "effort": "6e4 V*s/m"},
    "shunt_schedule": {"begin": "1 s"},
    "shunt_tuner": {"sensor": "v", "frequency": "3.4 kHz"},
    "squeal_switch": {"sensor": "v", "frequency": "3.4 kHz", "threshold": "5 mm/s"},
}
PAIRS = {key: [[0.5, 0.1]] for key in ("poles", "driven", "corrected", "fed_back")}
NUMBERS = {"sample_period": 20e-6, "capacitance": 30e-9, "delta": -0.5} | PAIRS  # of a design step


OWN = sorted(kind for kind, section in controllers.KINDS.items() if not issubclass(section, CompiledSection))
"""All kinds but those made of a compiled file, which have tests of their own."""


@pytest.fixture(params=OWN)
def controller(request):
    section = controllers.KINDS[request.param](kind=request.param, **SECTIONS[request.param])
    return controllers.build(section, NUMBERS)


def feedback(**given):
    return controllers.build(NormalForce(kind="normal_force", sensor="v", gain=200.0, nominal=20.0, **given), {})


def test_every_kind_is_a_controller(controller):
    assert isinstance(controller, Controller)
    assert controller.period_ns == 1_000_000
    _, commands = controller.update(
        controller.start(), 0, tuple((0.0,) if gets_every_sample(controller) else 0.0 for _ in controller.reads)
    )
    assert len(commands) == len(controller.drives)


def test_every_kind_travels_as_plain_values(controller):
    import json

    told = json.loads(json.dumps(controllers.described(controller.section, NUMBERS)))
    again = controllers.restored(told)
    assert again.section == controller.section
    assert again.numbers == NUMBERS


def test_retune_gives_a_new_controller_and_leaves_the_old():
    old = feedback()
    new = retune(old, {"gain": 300, "enable_at": "2 s"})
    assert (new.section.gain, new.section.enable_at) == (300.0, 2.0)
    assert old.section.gain == 200.0
    assert new.numbers is old.numbers


def test_a_faulty_change_names_every_fault_and_changes_nothing():
    old = feedback()
    with pytest.raises(UsageError) as told:
        retune(old, {"gain": "5 kg", "gian": 3, "period": "2 ms", "highest": -1, "enable_at": "3 s"})
    text = str(told.value)
    assert "gain: is '5 kg'; expected a unit that converts to N*s/m" in text
    assert "gian: no such parameter; near: gain" in text
    assert "period: is fixed while the rig runs" in text
    assert "highest:" in text
    assert old.section.enable_at == 0.0


def test_what_decides_the_observer_is_fixed():
    for key, value in (("sensor", "x"), ("velocity", "observed"), ("drive", "drive.speed"), ("kind", "dither")):
        with pytest.raises(UsageError, match=f"{key}: is fixed"):
            retune(feedback(), {key: value})
