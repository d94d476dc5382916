"""What effects declare of themselves."""

from typing import Annotated, ClassVar

from rig.about import About, Bound
from rig.quantities import Second, Section, Speed
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
    assert [(effect.name, effect.key, effect.given) for effect in optional(PLANT)] == [
        ("motor lag", "motor.lag", False),
        ("motor limits", "motor.speed_min", False),
        ("motor limits", "motor.speed_max", True),
        ("shaker", "shaker", True),
        ("again", "again", False),
    ]
    assert switches(PLANT) == ["shaker.enable"]


def test_a_field_says_more_than_the_class_of_its_table():
    names = ("shaker", "again", "motor lag", "motor remark", "nothing at all")
    assert [about(PLANT, name) for name in names] == ["shakes", "shakes once more", "is late", "", ""]
    assert (declared(PLANT)["shaker"].hardware, declared(PLANT)["shaker"].needs) == (True, ("motor",))
    assert not declared(PLANT)["again"].hardware
