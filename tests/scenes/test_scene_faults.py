"""What a user is told: key, what was given, what is allowed, near names; everything at once."""

import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
def faults(tmp_path):
    """The faults of the scene above with lines added or replaced."""

    def found(*changes, more="", **overrides):
        text = BELT
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "mine.toml"
        path.write_text(text + more)
        with pytest.raises(SceneError) as caught:
            scenes.load(path, overrides.get("overrides", {}))
        return caught.value.faults

    return found


def test_a_plain_scene_loads(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(BELT)
    scene = scenes.load(path)
    assert scene.name == "mine"
    assert scene.parameters.body.mass == 5.0
    assert scene.origins["body.damping"] == ("calibrated", "note")
    assert (scene.step_ns, scene.frame_ns, scene.duration_ns) == (1_000_000, 1_000_000, None)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('force = "20 N"', 'force = "-3 N"', 'load.force = "-3 N": must be at least 0 N'),
        ("speed = 0.06", "sped = 0.06\nspeed = 1", "drive.sped: unknown key; did you mean drive.speed?"),
        ('law = "coulomb"', 'law = "strbeck"', 'friction.law = "strbeck": unknown; did you mean stribeck? known: '),
        (
            "stiffness = 2500",
            'stiffness = "2500 kg"',
            'body.stiffness = "2500 kg": expected a unit that converts to N/m',
        ),
        ("stiffness = 2500", 'stiffness = "2500"', 'body.stiffness = "2500": without a unit; expected N/m'),
        ("stiffness = 2500", "stiffness = nan", "body.stiffness = NaN: must be a finite number"),
        ("stiffness = 2500", "", "body.stiffness: is missing; expected a value in N/m"),
        ('"5 kg"', '["5 kg", "papr"]', 'body.mass: origin = "papr": unknown; did you mean paper? known: '),
        ('"5 kg"', '"0 kg"', 'body.mass = "0 kg": must be greater than 0 kg'),
        ("[load]", "[lod]", "lod: unknown key; did you mean load?"),
        ("sensors.vibrometer", f"sensors.{'v' * 65}", f"sensors.{'v' * 65}: a name is at most 64 letters"),
        ("controllers.nf", f"controllers.{'n' * 65}", f"controllers.{'n' * 65}: a name is at most 64 letters"),
        ('plant = "belt"', 'plant = "blet"', 'plant = "blet": unknown; did you mean belt? known: belt, '),
        ('plant = "belt"', "", 'plant: is missing, and so is based_on = "SCENE"; known: belt, '),
        ('plant = "belt"', 'plant = "belt"\nseed = -1', "seed = -1: expected a whole number, at least 0"),
        ("_vibrometer", "_vibrometr", 'sensors.vibrometer.kind = "laser_vibrometr": unknown; did you mean laser_vibr'),
        ('kind = "laser_vibrometer"', "", "sensors.vibrometer.kind: is missing; known: accelerometer, "),
        ('sensor = "vibrometer"', "", "controllers.nf.sensor: is missing"),
        (
            'sensor = "vibrometer"',
            'sensor = "vibromter"',
            'controllers.nf.sensor = "vibromter": unknown sensor; did you mean vibrometer?',
        ),
        (
            'sensor = "vibrometer"',
            'sensor = "vibrometer"\ndrive = "load.frce"',
            'controllers.nf.drive = "load.frce": belt has no such actuator; did you mean load.force?',
        ),
        (
            'kind = "laser_vibrometer"',
            'kind = "laser_vibrometer"\nreads = "disc_speed"',
            'sensors.vibrometer.reads = "disc_speed": belt has no such output; did you mean ',
        ),
        (
            'kind = "laser_vibrometer"',
            'kind = "laser_vibrometer"\nreads = "displacement"',
            'sensors.vibrometer.reads = "displacement": is in m, a laser_vibrometer reads m/s; '
            "outputs in this unit: velocity, ",
        ),
        (
            'kind = "laser_vibrometer"',
            'kind = "laser_vibrometer"\nrate = "0.5 Hz"',
            'sensors.vibrometer.rate = "0.5 Hz": must be at least 1 Hz',
        ),
        (
            'sensor = "vibrometer"',
            'sensor = "vibrometer"\nperiod = "0.7 ms"',
            'controllers.nf.period = "0.7 ms": 0.7 ms is not a whole number of frames (1 ms); nearest: 1 ms',
        ),
        (
            'sensor = "vibrometer"',
            'sensor = "vibrometer"\ndelay = "2.5 ms"',
            'controllers.nf.delay = "2.5 ms": 2.5 ms is not a whole number of frames (1 ms); nearest: 2 ms or 3 ms',
        ),
    ],
)
def test_one_fault_one_line(faults, old, new, told):
    found = faults((old, new))
    assert any(line.startswith(told) for line in found), found


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (
            '[limits]\ndisplacment = "1 m"',
            "limits.displacment: this rig has no such output; did you mean displacement?",
        ),
        ('[limits]\ndisplacement = "1 kg"', 'limits.displacement = "1 kg": expected a unit that converts to m'),
        ("[limits]\ndisplacement = 0", "limits.displacement = 0: must be 1e-12 to 10000 m"),
        ('[clock]\nmethod = "exct"', 'clock.method = "exct": unknown; known: auto, exact, dopri5, rk4'),
        (
            '[clock]\nmethod = "rk4"\nrk4_step = "0.3 ms"',
            'clock.rk4_step = "0.3 ms": 0.3 ms is not a whole part of the sample step (1 ms); nearest: 0.25 ms',
        ),
        ('[[protocol]]\nstep = "hld"', 'protocol[1].step = "hld": unknown; did you mean hold? known: connect, '),
        ('[[protocol]]\nstep = "hold"', "protocol[1].time: is missing; expected a value in s"),
        (
            '[[protocol]]\nstep = "hold"\ntime = "1.5 ms"',
            'protocol[1].time = "1.5 ms": 1.5 ms is not a whole number of frames (1 ms); nearest: 1 ms or 2 ms',
        ),
        (
            '[[protocol]]\nstep = "ramp"\ntarget = "drive.spd"\nto = 1\nover = "1 s"',
            'protocol[1].target = "drive.spd": unknown actuator; did you mean drive.speed?',
        ),
        (
            '[[protocol]]\nstep = "ramp"\ntarget = "drive.speed"\nto = "2 rpm"\nover = "1 s"',
            'protocol[1].to = "2 rpm": expected a unit that converts to m/s',
        ),
        (
            '[[protocol]]\nstep = "ramp"\ntarget = "load.force"\nto = "2 N"\nover = "1 s"',
            "protocol[1].ramp: load.force is driven by controllers.nf at this point",
        ),
        (
            '[[protocol]]\nstep = "wait"\nsensor = "vibrometer"',
            "protocol[1]: needs one of above, below, quiet, settled; given: none",
        ),
        (
            '[[protocol]]\nstep = "repeat"\ntimes = 0\nsteps = []',
            'protocol[1].times = 0: expected a whole number above 0 and at most 1000000, or "forever"',
        ),
        (
            '[[protocol]]\nstep = "repeat"\ntimes = "forever"\nsteps = [{step = "mark", text = "x"}]',
            "protocol[1]: steps repeated forever must take time: add a hold",
        ),
        (
            '[[protocol]]\nstep = "repeat"\ntimes = 2\nsteps = [{step = "connect", controller = "fn"}]',
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


def test_all_faults_at_once(faults):
    found = faults(
        ('"5 kg"', '"5 N"'),
        ('law = "coulomb"', 'law = "colomb"'),
        ('sensor = "vibrometer"', 'sensor = "vibrometer"\ngain = "3 m"'),
        more='[clock]\nframe = "0 s"\n[[protocol]]\nstep = "hold"\ntime = "x"',
    )
    keys = [line.partition(" ")[0].rstrip(":") for line in found]
    assert keys == ["clock.frame", "body.mass", "friction.law", "controllers.nf.gain", "protocol[1].time"]


@pytest.mark.parametrize(
    ("scene", "key", "value", "told"),
    [
        ("disc_slider", "slider.radius", "0.13 m", 'slider.radius = "0.13 m": is outside of the disc'),
        ("disc_slider", "slider.radius", "0.04 m", 'slider.radius = "0.04 m": is inside of the clamp'),
        ("disc_slider", "probe.radius", "0.3 m", "at most outer_radius 0.12 m"),
        ("brake_disc_modes", "linings.radius", "0.06 m", "inside of the clamp: more than inner_radius 0.07 m"),
        ("plate", "probe.y", "1 m", "beside the plate"),
        ("plate", "slider.width", "1 m", "slider.width 1 m is not below plate.width"),
        ("brake_shunt_sound", "sensors.microphone.distance", "2 m", "no longer than the direct way of 2 m"),
    ],
)
def test_geometry_that_cannot_be_is_refused(scene, key, value, told):
    with pytest.raises(SceneError, match=told):
        scenes.load(scene, {key: value})


def test_broken_toml_is_named_with_line_and_column(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text('plant = "belt"\nbody == 3\n')
    with pytest.raises(SceneError, match=r"line 2, column 7"):
        scenes.load(path)
    path.write_text("a = 1\nb = [1,")
    with pytest.raises(SceneError, match=r"line 2, column \d"):
        scenes.load(path)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("speed = 0,1", "a number has a decimal point"),
        ("speed = \u22120,1 m/s", "a number has a decimal point"),
        ("speed = 0.1 m/s", 'a value with a unit is in quotes, "2 rpm"'),
        ("mass = 2kg # light", 'a value with a unit is in quotes, "2 rpm"'),
        ("speed = 0.1 0.2", "statement$"),
        ("speed = 1e3 ,", "statement$"),
        ('title = "a" 0,1', "statement$"),
    ],
)
def test_a_number_that_toml_cannot_read_is_explained(tmp_path, line, told):
    path = tmp_path / "typed.toml"
    path.write_text(f"format = 1\n{line}\n")
    with pytest.raises(SceneError, match=f"line 2, column .*{told}"):
        scenes.load(path)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(SceneError, match="there is no such file"):
        scenes.load(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SceneError, match="not text in UTF-8"):
        scenes.load(tmp_path / "binary.toml")
    with pytest.raises(SceneError, match=r"is the text of a scene; rig\.scenes\.scene\.Scene\.from_json reads it"):
        scenes.load(scenes.load("belt").to_json())
    with pytest.raises(SceneError, match=r"no scene has this name; did you mean pendulum\?"):
        scenes.load("pendulm")


def test_overrides_take_units_and_are_the_users_own():
    scene = scenes.load("pendulum", {"drive.speed": "2 rpm", "friction.mu_static": "0.55", "seed": 7})
    assert scene.parameters.drive.speed == pytest.approx(0.20943951, rel=1e-6)
    assert scene.parameters.friction.mu_static == 0.55
    assert scene.seed == 7
    assert scene.origins["drive.speed"].origin == "user"


def test_overrides_refuse_what_they_cannot_change():
    with pytest.raises(SceneError) as caught:
        scenes.load("belt", {"plant": "pendulum", "a..b": 1, "load.force.x": 3, "drive.sped": "1 m/s"})
    assert [line.partition(":")[0] for line in caught.value.faults] == [
        "plant",
        "'a..b'",
        "load.force.x = 3",
        "drive.sped",
    ]


def test_another_law_keeps_the_numbers_that_it_shares_and_leaves_the_others_behind():
    scene = scenes.load("belt", {"friction.law": "coulomb", "friction.mu_kinetic": "0.25"})
    static = scenes.load("belt").parameters.friction.mu_static
    assert scene.parameters.friction.model_dump() == {"law": "coulomb", "mu_static": static, "mu_kinetic": 0.25}
    assert scene.notes == ("friction.law = coulomb: dropped mu_dynamic, speed_scale of stribeck; kept mu_static",)
    scene = scenes.load("belt", {"friction.mu_static": 0.5, "friction.law": "coulomb", "friction.mu_kinetic": "0.25"})
    assert scene.parameters.friction.model_dump() == {"law": "coulomb", "mu_static": 0.5, "mu_kinetic": 0.25}
    assert "friction.mu_dynamic" not in scene.origins
    with pytest.raises(SceneError, match=r"friction\.mu_kinetc: unknown key; did you mean friction\.mu_kinetic"):
        scenes.load("belt", {"friction.law": "coulomb", "friction.mu_kinetc": "0.25"})


def test_none_takes_an_effect_away():
    assert scenes.load("pendulum", {"load.lag": "none"}).parameters.load.lag is None
    with pytest.raises(SceneError, match="is not in the scene"):
        scenes.load("belt", {"dither": "none"})


def test_the_step_meets_every_sample():
    scene = scenes.load("pendulum", {"sensors.vibrometer.rate": "10 kHz", "sensors.disc_speed.rate": "25 Hz"})
    assert scene.step_ns == 100_000
    scene = scenes.load("pendulum", {"sensors.vibrometer.rate": "2 kHz", "sensors.disc_speed.rate": "5 kHz"})
    assert scene.step_ns == 100_000


def test_a_controller_that_is_disconnected_leaves_its_actuator_to_the_protocol(tmp_path):
    path = tmp_path / "mine.toml"
    steps = """
[[protocol]]
step = "ramp"
target = "load.force"
to = 10
over = 1
[[protocol]]
step = "connect"
controller = "nf"
[[protocol]]
step = "disconnect"
controller = "nf"
[[protocol]]
step = "repeat"
times = "forever"
steps = [{step = "load", force = 5, over = "0.5 s"}, {step = "hold", time = "1 s"}]
"""
    path.write_text(BELT + steps)
    scene = scenes.load(path)
    assert scene.duration_ns is None
    assert scene.moved == {"load.force": "ramped"}
    assert scenes.Scene.from_json(scene.to_json()) == scene


@settings(max_examples=60)
@given(st.data())
def test_any_broken_value_ends_in_a_scene_error_that_names_its_key(tmp_path_factory, data):
    raw = tomllib.loads(BELT)
    table = data.draw(st.sampled_from(["body", "drive", "load", "friction"]))
    key = data.draw(st.sampled_from(sorted(raw[table])))
    value = data.draw(st.sampled_from(["'x y z'", "'1 banana'", "true", "[1, 2]", "{a = 1}", "-1e400", "''"]))
    with pytest.raises(SceneError) as caught:
        scenes.load(_file(tmp_path_factory), {f"{table}.{key}": value})
    assert all(line.startswith(f"{table}.{key}") for line in caught.value.faults), caught.value.faults


def _file(factory):
    path = factory.mktemp("scene") / "mine.toml"
    path.write_text(BELT)
    return path


def test_a_file_may_begin_with_the_mark_of_its_encoding(tmp_path):
    marked = tmp_path / "marked.toml"
    marked.write_bytes(b"\xef\xbb\xbf" + shipped.path("belt").read_bytes())
    assert scenes.load(marked).plant == "belt"


def test_a_file_named_without_its_ending_is_pointed_out(tmp_path, monkeypatch):
    (tmp_path / "mine.toml").write_text("")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError, match=r"no scene has this name; the file is called mine\.toml"):
        scenes.load("mine")


@pytest.mark.parametrize(
    ("name", "changes", "told"),
    [
        (
            "belt",
            {"friction.law": "table", "friction.speeds": "[0, 1]", "friction.values": "[0.4, 0.3]"},
            ["friction.law = table: dropped mu_static, mu_dynamic, speed_scale of stribeck"],
        ),
        (
            "brake_shunt",
            {"shunt.kind": "open"},
            [
                "shunt.kind = open: dropped connected, resistance, inductance, delta of series",
                "protocol[2]: left out, there is no shunt.connected any more",
                "protocol[4]: left out, there is no shunt.connected any more",
            ],
        ),
        (
            "belt_normal_force",
            {"controllers.nf.kind": "belt_velocity"},
            ["controllers.nf.kind = belt_velocity: dropped gain of normal_force; kept sensor, enable_at"],
        ),
        (
            "belt",
            {"sensors.laser.kind": "accelerometer", "sensors.laser.noise": "none"},
            ["sensors.laser.kind = accelerometer: dropped reads, span of displacement_laser; kept rate"],
        ),
        ("belt", {"friction.law": "stribeck"}, []),
    ],
)
def test_a_changed_kind_drops_the_values_of_the_old_one_and_says_so(name, changes, told):
    scene = scenes.load(name, changes)
    assert list(scene.notes) == told
    assert not [key for key in scene.origins if key not in scene.values() and key.startswith(("friction.", "shunt."))]
    assert scenes.Scene.from_json(scene.to_json()) == scene


def test_a_table_has_no_static_friction_of_the_law_before():
    points = {"friction.law": "table", "friction.speeds": "[0, 1]", "friction.values": "[0.4, 0.3]"}
    assert scenes.load("belt", points).parameters.friction.mu_static is None
    assert scenes.load("belt", points | {"friction.mu_static": 0.6}).parameters.friction.mu_static == 0.6


@pytest.mark.parametrize("kind", ["open", "short"])
def test_a_shunt_is_opened_or_shorted_by_its_kind(kind):
    scene = scenes.load("brake_shunt", {"shunt.kind": kind})
    assert scene.parameters.shunt.kind == kind
    assert "shunt.connected" not in scene.assemble().inputs
    assert [step.step for step in scene.protocol].count("mark") >= 2
    assert scene.duration_ns == scenes.load("brake_shunt").duration_ns
