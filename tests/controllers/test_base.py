import pytest

from rig import controllers
from rig.controllers.blocks.base import retune
from rig.controllers.normal_force import NormalForce
from rig.errors import UsageError


def feedback(**given):
    return controllers.build(NormalForce(kind="normal_force", sensor="v", gain=200.0, nominal=20.0, **given), {})


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
