"""What a user is told: key, what was given, what is allowed, near names; everything at once."""

import pytest

from rig import scenes
from rig.errors import SceneError
from rig.scenes import shipped

BELT = """
plant = "belt"
[body]
mass = "5 kg"
stiffness = 2500
damping = ["2 N*s/m", "calibrated", "note"]
[drive]
speed = 0.06
[load]
force = "20 N"
[friction]
law = "coulomb"
mu_static = 0.4
mu_kinetic = 0.25
[sensors.vibrometer]
kind = "laser_vibrometer"
[controllers.nf]
kind = "normal_force"
sensor = "vibrometer"
"""


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(BELT)
    return path


@pytest.fixture
def faults(mine):
    """The faults of the scene above with lines added or replaced."""

    def found(*changes, more=""):
        text = BELT
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        mine.write_text(text + more)
        return refused(mine)

    return found


def refused(scene, changes=None):
    with pytest.raises(SceneError) as caught:
        scenes.load(scene, changes)
    return caught.value.faults


KIND, SENSOR = 'kind = "laser_vibrometer"', 'sensor = "vibrometer"'


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("stiffness = 2500", "", "body.stiffness: is missing; expected a value in N/m"),
        (KIND, "", "sensors.vibrometer.kind: is missing; known: accelerometer, "),
        ('law = "coulomb"', "", "friction.law: is missing; known: constant, "),
        (
            "[controllers.nf]",
            "[controllers]\nother = 3\n[controllers.nf]",
            "controllers.other = 3: expected a table with kind",
        ),
        ("[drive]", '[clock]\nunstable = "yes"\n[drive]', 'clock.unstable = "yes": unknown; known: refuse, run'),
        ('"5 kg"', '["5 kg", "papr"]', 'body.mass: origin = "papr": unknown; did you mean paper? known: '),
        ('plant = "belt"', 'plant = "blet"', 'plant = "blet": unknown; did you mean belt? known: belt, '),
        (
            SENSOR,
            'sensor = "vibromter"',
            'controllers.nf.sensor = "vibromter": unknown sensor; did you mean vibrometer?',
        ),
        (
            KIND,
            f'{KIND}\nreads = "displacement"',
            'sensors.vibrometer.reads = "displacement": is in m, a laser_vibrometer '
            "reads m/s; outputs in this unit: velocity, ",
        ),
    ],
)
def test_one_fault_one_line(faults, old, new, told):
    found = faults((old, new))
    assert any(line.startswith(told) for line in found), found


def step(kind, **values):
    return f'[[protocol]]\nstep = "{kind}"\n' + "\n".join(f"{key} = {value}" for key, value in values.items())


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (
            '[limits]\ndisplacment = "1 m"',
            "limits.displacment: this rig has no such output; did you mean displacement?",
        ),
        (
            '[clock]\nmethod = "rk4"\nrk4_step = "0.3 ms"',
            'clock.rk4_step = "0.3 ms": 0.3 ms is not a whole part of the sample step (1 ms); nearest: 0.25 ms',
        ),
        (
            step("ramp", target='"load.force"', to=2, over=1),
            "protocol[1].ramp: load.force is driven by controllers.nf at ",
        ),
        (step("wait", sensor='"vibrometer"'), "protocol[1]: needs one of above, below, quiet, settled; given: none"),
        (
            step("repeat", times='"forever"', steps='[{step = "mark", text = "x"}]'),
            "protocol[1]: steps repeated forever must take time: add a hold",
        ),
        (
            step("repeat", times=2, steps='[{step = "connect", controller = "fn"}]'),
            'protocol[1].steps[1].controller = "fn": unknown controller; ',
        ),
        (
            '[controllers.other]\nkind = "normal_force"\nsensor = "vibrometer"',
            "controllers.nf and controllers.other: both drive load.force; only one can",
        ),
    ],
)
def test_faults_between_the_parts(faults, more, told):
    found = faults(more=more)
    assert any(line.startswith(told) for line in found), found


@pytest.mark.parametrize(
    ("scene", "key", "value", "told"),
    [
        ("plate", "probe.y", "1 m", "beside the plate"),
        ("brake_shunt_sound", "sensors.microphone.distance", "2 m", "no longer than the direct way of 2 m"),
    ],
)
def test_geometry_that_cannot_be_is_refused(scene, key, value, told):
    with pytest.raises(SceneError, match=told):
        scenes.load(scene, {key: value})


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a = 1\nb = [1,", r"line 2, column \d"),
        ("format = 1\nmass = 2kg # light\n", 'line 2, column .*a value with a unit is in quotes, "2 rpm"'),
        ('format = 1\ntitle = "a" 0,1\n', "line 2, column .*statement$"),
    ],
)
def test_broken_toml_is_named_with_line_and_column(mine, text, told):
    mine.write_text(text)
    with pytest.raises(SceneError, match=told):
        scenes.load(mine)


def test_files_that_cannot_be_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("")
    text = scenes.load("belt").to_json()
    for name, told in (
        ("none.toml", "there is no such file"),
        (text, r"is the text of a scene; rig\.scenes\.scene\.Scene\.from_json reads it"),
        ("pendulm", r"no scene has this name; did you mean pendulum\?"),
        ("mine", r"no scene has this name; the file is called mine\.toml"),
    ):
        with pytest.raises(SceneError, match=told):
            scenes.load(name)


def test_overrides_refuse_what_they_cannot_change():
    told = refused("belt", {"plant": "pendulum", "a..b": 1, "load.force.x": 3, "drive.sped": "1 m/s"})
    assert [line.partition(":")[0] for line in told] == ["plant", "'a..b'", "load.force.x = 3", "drive.sped"]


def test_the_step_meets_every_sample():
    scene = scenes.load("pendulum", {"sensors.vibrometer.rate": "10 kHz", "sensors.disc_speed.rate": "25 Hz"})
    assert scene.step_ns == 100_000
    scene = scenes.load("pendulum", {"sensors.vibrometer.rate": "2 kHz", "sensors.disc_speed.rate": "5 kHz"})
    assert scene.step_ns == 100_000


def test_a_controller_that_is_disconnected_leaves_its_actuator_to_the_protocol(mine):
    steps = [
        step("ramp", target='"load.force"', to=10, over=1),
        step("connect", controller='"nf"'),
        step("disconnect", controller='"nf"'),
        step(
            "repeat",
            times='"forever"',
            steps='[{step = "load", force = 5, over = "0.5 s"}, {step = "hold", time = "1 s"}]',
        ),
    ]
    mine.write_text("\n".join([BELT, *steps]))
    scene = scenes.load(mine)
    assert scene.duration_ns is None
    assert scene.moved == {"load.force": "ramped"}
    assert scenes.Scene.from_json(scene.to_json()) == scene


def test_a_file_may_begin_with_the_mark_of_its_encoding(tmp_path):
    marked = tmp_path / "marked.toml"
    marked.write_bytes(b"\xef\xbb\xbf" + shipped.path("belt").read_bytes())
    assert scenes.load(marked).plant == "belt"


def test_a_changed_kind_drops_the_values_of_the_old_one_and_says_so():
    scene = scenes.load("brake_shunt", {"shunt.kind": "open"})
    assert list(scene.notes) == [
        "shunt.kind = open: dropped connected, resistance, inductance, delta of series",
        "protocol[2]: left out, there is no shunt.connected any more",
        "protocol[4]: left out, there is no shunt.connected any more",
    ]
    assert not [key for key in scene.origins if key not in scene.values() and key.startswith("shunt.")]
    assert scenes.Scene.from_json(scene.to_json()) == scene
