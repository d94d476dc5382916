"""What effects declare of themselves, and that every shipped one does."""

from typing import Annotated, ClassVar

import pytest

from rig import scenes
from rig.about import About, Bound
from rig.quantities import Second, Section, Speed
from rig.scenes.explain import explain
from rig.scenes.variants import about, declared, optional, switches


class Shaker(Section):
    declares: ClassVar = About("shakes", hardware=True, needs=("motor",), switch="enable")

    enable: bool = True


class Motor(Section):
    speed: Speed
    lag: Annotated[Second | None, About("is late")] = None
    speed_min: Annotated[Speed | None, Bound(of="speed", sign=-1)] = None
    speed_max: Annotated[Speed | None, Bound(of="speed", sign=1)] = None
    remark: str | None = None


class Parameters(Section):
    motor: Motor
    shaker: Shaker | None = None
    again: Annotated[Shaker | None, About("shakes once more")] = None


PLANT = Parameters(motor=Motor(speed=1.0, speed_max=2.0), shaker=Shaker())


def test_a_plant_may_be_without_optional_tables_and_values_that_say_what_they_are():
    found = [(one.name, one.key, one.given) for one in optional(PLANT)]
    assert found == [
        ("motor lag", "motor.lag", False),
        ("motor limits", "motor.speed_min", False),
        ("motor limits", "motor.speed_max", True),
        ("shaker", "shaker", True),
        ("again", "again", False),
    ]


def test_a_field_says_more_than_the_class_of_its_table():
    assert [about(PLANT, name) for name in ("shaker", "again", "motor lag")] == [
        "shakes",
        "shakes once more",
        "is late",
    ]
    assert about(PLANT, "motor remark") == about(PLANT, "nothing") == about(PLANT, "nothing at all") == ""
    assert declared(PLANT)["shaker"].hardware
    assert declared(PLANT)["shaker"].needs == ("motor",)
    assert not declared(PLANT)["again"].hardware


def test_switches_are_those_of_tables_that_are_there():
    assert switches(PLANT) == ["shaker.enable"]


@pytest.mark.parametrize("name", scenes.names())
def test_every_effect_of_a_shipped_scene_says_what_it_is(name):
    assert [one.name for one in explain(scenes.load(name)).effects if not one.about] == []
