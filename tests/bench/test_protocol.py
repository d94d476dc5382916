"""The steps of an experiment on ticks."""

import numpy as np
import pytest
from pydantic import TypeAdapter

import rig
from rig.bench.again.fork import fork
from rig.bench.again.verify import verify
from rig.bench.run.actions import Apply, Finish, Move, Note, Release, Strike
from rig.bench.run.protocol import Protocol
from rig.errors import SceneError
from rig.model.assembly import Input
from rig.scenes.protocol import Step

MS = 1_000_000
STEPS = TypeAdapter(tuple[Step, ...])
INPUTS = {"drive.speed": Input("m/s", -1.0, 1.0, 0.0, 0.0), "load.force": Input("N", 0.0, 100.0, 20.0, 20.0)}
SENSORS = {"vibrometer": "m/s", "laser": "m"}


def protocol(*steps):
    return Protocol(STEPS.validate_python(steps), MS, SENSORS, INPUTS)


def carried_out(made, ticks, signal=lambda tick: 0.0):
    """(tick, action) of everything but the notes of begun steps."""
    found = []
    for tick in range(ticks):
        for action in made.due(tick, np.array([signal(tick), 0.0])):
            if not (isinstance(action, Note) and action.kind == "step"):
                found.append((tick, action))
    return found


def hold(ms):
    return {"step": "hold", "time": ms * 1e-3}


def wait(**more):
    return {"step": "wait", "sensor": "vibrometer", **more}


def mark(text="here"):
    return {"step": "mark", "text": text}


HERE = Note("mark", "here")


def test_accelerate_hold_decelerate():
    made = protocol(
        {"step": "load", "force": 20.0, "over": 0.01},
        {"step": "ramp", "target": "drive.speed", "to": 0.5, "over": 0.1},
        hold(50),
        {"step": "ramp", "target": "drive.speed", "to": 0.0, "over": 0.1},
        mark("at rest"),
    )
    assert carried_out(made, 400) == [
        (0, Move("load.force", 20.0, 10)),
        (10, Apply("load.force", 20.0)),
        (10, Move("drive.speed", 0.5, 100)),
        (110, Apply("drive.speed", 0.5)),
        (160, Move("drive.speed", 0.0, 100)),
        (260, Apply("drive.speed", 0.0)),
        (260, Note("mark", "at rest")),
    ]
    assert made.done


def test_a_knock_with_a_duration_ends_before_the_next_step():
    made = protocol({"step": "knock", "impulse": 0.1, "duration": 0.01}, mark())
    assert carried_out(made, 100) == [(0, Strike(0.1, 10_000_000)), (10, Release()), (10, HERE)]
    assert made.done


def test_repeats_are_unrolled():
    inner = {"step": "repeat", "times": 2, "steps": [hold(3), mark()]}
    made = protocol({"step": "repeat", "times": 3, "steps": [inner, hold(4)]})
    assert [tick for tick, _ in carried_out(made, 60)] == [3, 6, 13, 16, 23, 26]
    assert made.done


def test_forever_has_no_end_and_says_so():
    made = protocol({"step": "repeat", "times": "forever", "steps": [hold(10), mark()]})
    assert len(carried_out(made, 1001)) == 100
    assert not made.done
    assert made.progress(1001)[2:] == (None, None, None)


@pytest.mark.parametrize(
    ("condition", "tick"), [({"above": 0.5}, 51), ({"below": 0.5}, 0), ({"above": 2.0, "timeout": 0.2}, 200)]
)
def test_wait_for_a_value(condition, tick):
    made = protocol(wait(**condition), mark())
    found = carried_out(made, 300, lambda tick: tick * 0.01)
    assert found[-1] == (tick, HERE)
    assert any(isinstance(a, Note) and a.kind == "timeout" for _, a in found) == ("timeout" in condition)


def test_a_wait_in_vain_can_end_the_run():
    made = protocol(wait(above=1.0, timeout=0.1, otherwise="stop"))
    ((tick, action),) = carried_out(made, 101)
    assert tick == 100
    assert isinstance(action, Finish)
    assert "vibrometer is above 1 m/s: not so within 0.1 s" in action.reason


def test_quiet_is_half_the_peak_to_peak_of_a_window():
    made = protocol(wait(quiet=0.1, window=0.05), mark())
    found = carried_out(made, 3000, lambda tick: np.exp(-tick / 500) * np.cos(tick / 3) + 7.0)
    assert 0 <= found[0][0] - 500 * np.log(10) < 50


def test_settled_compares_two_windows():
    made = protocol(wait(settled=0.01, window=0.05), mark())
    found = carried_out(made, 3000, lambda tick: (1 + np.exp(-tick / 200)) * np.cos(2 * np.pi * tick / 25))
    change = (np.exp(50 / 200) - 1) * np.exp(-np.arange(3000) / 200)
    expected = int(np.argmax(change < 0.01)) + 50
    assert found[0][0] == pytest.approx(expected, abs=30)


def test_samples_that_are_no_numbers_say_nothing():
    made = protocol(wait(quiet=0.1, window=0.02), mark())
    assert carried_out(made, 300, lambda tick: float("nan") if tick < 100 else 0.0)[0][0] == 119
    made = protocol(wait(below=0.1), mark())
    assert carried_out(made, 300, lambda tick: float("nan") if tick < 100 else 0.0)[0][0] == 100


T = np.delete(np.arange(0.0, 0.4, 4e-4), range(500, 510))  # 2.5 kHz, with a gap of 11 periods from 0.1996 s on
SPEED, FORCE = 0.2 + 0.1 * np.sin(20.0 * T), np.where(T < 0.2, 20.0, 18.0)


@pytest.fixture
def following(tmp_path):
    """A scene that follows the speed and the load of a measurement, made by the rest of the keys of its step."""
    np.savetxt(tmp_path / "m.csv", np.column_stack([T, SPEED, FORCE]), delimiter=",", header="t,v,F", comments="")
    channels = {"v": "belt, m/s", "F": "load, N"}
    rig.import_(tmp_path / "m.csv", tmp_path / "m.mcap", channels, time="t, s")

    def made(keys='channels = {"drive.speed" = "belt", "load.force" = "load"}', file="m.mcap", above=""):
        path = tmp_path / "following.toml"
        step = f'[[protocol]]\nstep = "follow"\nfile = "{file}"\n{keys}\n'
        path.write_text(f'based_on = "belt"\n{above}\n{step}[[protocol]]\nstep = "hold"\ntime = "0.1 s"\n')
        return rig.load(path)

    return made


def test_actuators_follow_a_measurement_and_the_recording_needs_only_itself(following, tmp_path):
    scene = following()
    assert "1 gap of belt bridged by a straight line, the longest takes 0.0044 s from 0.1996 s on" in scene.notes[0]
    run = rig.simulate(scene)
    frames = np.rint(run.time * 1e9).astype(int) % scene.frame_ns == 0
    t = run.time[frames]
    for name, measured in (("surface_speed", SPEED), ("normal_force", FORCE)):
        expected = np.interp(np.minimum(t, 0.399), T, measured)  # whole frames, then the last value is held
        assert run.signals[name][frames] == pytest.approx(expected, rel=1e-12)
    assert t[-1] == pytest.approx(0.499)
    log = tmp_path / "following.mcap"
    run.save(log)
    (tmp_path / "m.mcap").unlink()
    assert verify(log).identical
    again = fork(log, 0.2015)
    assert all(np.array_equal(again.signals[name], run.signals[name]) for name in run.signals)


def test_part_of_a_recording_is_followed_and_its_frames_are_those_of_the_scene(following):
    keys = 'channels = {"drive.speed" = "belt"}\nbegin = "0.1001 s"\nend = "150 ms"'
    scene = following(keys, above='[clock]\nframe = "2 ms"')
    (speeds,) = scene.protocol[0].file.values(1)
    assert speeds == pytest.approx(np.interp(0.1001 + 2e-3 * np.arange(25), T, SPEED), rel=1e-12)
    assert scene.duration_ns == 48 * MS + 100 * MS


@pytest.mark.parametrize(
    ("keys", "more", "words"),
    [
        ('channels = {"drive.speed" = "bolt", "load.force" = "belt"}', {}, "no 'bolt'.*belt is in m/s, not in N"),
        ('channels = {"drive.speed" = "belt"}\nend = "2 s"', {}, "belt has samples from 0 s to 0.3996 s"),
        ('channels = {"drive.speed" = "belt"}', {"file": "m.csv"}, "make one of a measurement: rig import m.csv"),
        (
            'channels = {"drive.speed" = "belt"}',
            {"above": '[drive]\nspeed_max = "0.25 m/s"'},
            "drive.speed takes .* to 0.25 m/s, not 0.299",
        ),
    ],
)
def test_what_cannot_be_followed_is_named(following, keys, more, words):
    with pytest.raises(SceneError, match=f"(?s){words}"):
        following(keys, **more)
