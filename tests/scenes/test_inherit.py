"""Scene files that are based on one another: what is merged, what is removed, where each value is from."""

import logging

import pytest

import rig
from rig import scenes
from rig.errors import SceneError


@pytest.fixture
def write(tmp_path):
    """Writes a scene file; its path."""

    def written(name, text):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        return path

    return written


def faults(path, overrides=None):
    with pytest.raises(SceneError) as caught:
        scenes.load(path, overrides)
    return list(caught.value.faults)


def test_a_scene_that_says_nothing_is_its_base(write):
    mine, belt = scenes.load(write("mine.toml", 'based_on = "belt"')), scenes.load("belt")
    assert mine.digest == belt.digest
    assert mine.origins == belt.origins
    assert (mine.name, mine.title, mine.about) == ("mine", "mine", "")
    assert mine.bases == ("scene belt",)


def test_tables_are_merged_and_origins_stay_with_their_values(write):
    mine = scenes.load(
        write("mine.toml", 'based_on = "belt"\n[friction]\nmu_static = ["0.6", "chosen", "mine"]\nmu_dynamic = 0.2\n')
    )
    friction = mine.parameters.friction
    assert (friction.mu_static, friction.mu_dynamic, friction.speed_scale) == (0.6, 0.2, 0.05)
    assert mine.origins["friction.mu_static"] == ("chosen", "mine")
    assert "friction.mu_dynamic" not in mine.origins
    assert mine.origins["friction.speed_scale"] == scenes.load("belt").origins["friction.speed_scale"]
    assert mine.notes == ()


def test_none_takes_sensors_values_and_effects_away(write):
    effect = '[dither]\non = "belt"\namplitude = "0.1 m/s"\nfrequency = "150 Hz"\n[drive]\nlag = "10 ms"\n'
    write("base.toml", f'based_on = "belt"\n{effect}')
    text = 'based_on = "base.toml"\ndither = "none"\n[drive]\nlag = "none"\n[sensors]\nlaser = "none"\n'
    mine = scenes.load(write("mine.toml", text))
    assert mine.parameters.dither is None
    assert mine.parameters.drive.lag is None
    assert set(mine.sensors) == {"vibrometer", "accelerometer"}
    assert not [key for key in mine.origins if key.startswith("sensors.laser")]
    assert mine.bases == ("base.toml", "scene belt")
    assert mine.digest == scenes.load("belt", {"sensors.laser": "none"}).digest


def test_a_protocol_is_replaced_whole(write):
    mine = scenes.load(write("mine.toml", 'based_on = "pendulum"\n[[protocol]]\nstep = "hold"\ntime = "2 s"\n'))
    assert [step.step for step in mine.protocol] == ["hold"]
    assert [key for key in mine.origins if key.startswith("protocol")] == []
    assert scenes.load(write("none.toml", 'based_on = "pendulum"\nprotocol = "none"\n')).protocol == ()


def test_a_section_of_another_kind_drops_the_values_of_the_old_one_and_says_so(write, caplog):
    path = write("mine.toml", 'based_on = "belt"\n\n[friction]\nlaw = "coulomb"\nmu_static = 0.5\nmu_kinetic = 0.25\n')
    told = ("friction.law = coulomb: dropped mu_dynamic, speed_scale of stribeck (mine.toml, line 4)",)
    with caplog.at_level(logging.WARNING, "rig"):
        mine = rig.load(path)
    assert mine.parameters.friction.model_dump() == {"law": "coulomb", "mu_static": 0.5, "mu_kinetic": 0.25}
    assert mine.notes == told
    assert caplog.messages == list(told)
    assert "friction.mu_dynamic" not in mine.origins
    assert scenes.load(write("later.toml", 'based_on = "mine.toml"\n[load]\nforce = "30 N"\n')).notes == told


def test_another_plant_keeps_what_is_not_of_the_plant(write):
    pin = scenes.load("pin")
    tables = scenes.path("pin").read_text().partition("[pin]")[2].partition("[sensors")[0]
    mine = scenes.load(write("mine.toml", f'based_on = "belt"\nplant = "pin"\nsensors = "none"\n[pin]{tables}'), {})
    assert mine.parameters == pin.parameters
    assert mine.protocol == scenes.load("belt").protocol
    assert mine.notes == ("plant = pin: dropped body, drive, load, friction, start of belt (mine.toml, line 2)",)


def test_paths_are_relative_to_the_file(write):
    write("base.toml", 'based_on = "belt"\n[load]\nforce = "30 N"\n')
    mine = scenes.load(write("deep/mine.toml", 'based_on = "../base.toml"'))
    assert mine.parameters.load.force == 30.0
    assert mine.bases == ("../base.toml", "scene belt")
    assert str(mine.place("load.force")) == "../base.toml, line 3"


def test_every_fault_says_which_file_and_line_its_value_is_from(write):
    write("base.toml", 'based_on = "belt"\n[load]\nforce = "-3 N"\n[drive]\nsped = 3\nlag = "none"\n')
    path = write("mine.toml", 'based_on = "base.toml"\n[friction]\nmu_static = "none"\n[sensors.laser]\nrate = 0\n')
    assert faults(path, {"seed": -1, "body.mass": "5 m"}) == [
        "drive.lag: is not in the base, so it cannot be removed (base.toml, line 6)",
        "seed = -1: expected a whole number, at least 0 (given in the call)",
        'body.mass = "5 m": expected a unit that converts to kg (given in the call)',
        "drive.sped: unknown key; did you mean drive.speed? (base.toml, line 5)",
        'load.force = "-3 N": must be at least 0 N (base.toml, line 3)',
        "friction.mu_static: is missing; expected a number (mine.toml, line 3)",
        "sensors.laser.rate = 0: must be at least 1 Hz (mine.toml, line 5)",
    ]


BASE = 'based_on = "belt"\n'


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        ('based_on = "broken.toml"', 1, 'based_on = "broken.toml": line 2, column 3: invalid value'),
        (
            'based_on = "mine.toml"',
            1,
            'based_on = "mine.toml": the files are based on one another in a circle: mine.toml, mine.toml',
        ),
        (
            f'{BASE}sensors.lasr = "none"',
            2,
            "sensors.lasr: is not in the base, so it cannot be removed; did you mean sensors.laser?",
        ),
        (f"{BASE}[protocol]\nstep = 'hold'", 2, "protocol: expected steps, each a table [[protocol]]"),
        ('[load]\nbased_on = "belt"', 2, "load.based_on: put based_on above the first table of the file"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(write, text, line, told):
    write("broken.toml", "a = 3\nb==3")
    assert f"{told} (mine.toml, line {line})" in faults(write("mine.toml", f"{text}\n"))


@pytest.mark.parametrize("key", ["plant", "based_on", "protocol[1].time"])
def test_what_only_a_file_can_change_is_told(key):
    what = f"{key}: only a scene file can change {key.partition('[')[0]}; write one with rig new and change it there"
    assert faults("belt", {key: "3 s"}) == [f"{what} (given in the call)"]
