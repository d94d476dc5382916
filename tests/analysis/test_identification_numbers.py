"""How often intervals hold: rigs drawn at random, identified, and compared with their truth.

python -m pytest tests/analysis/test_identification_numbers.py -m slow -n 0 -s       all 48 rigs: half an hour and more
RIGS=12 python -m pytest ...                    the first twelve
ROWS=rigs.jsonl python -m pytest ...            each rig is appended to this file, and not computed again
"""

import json
import math
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import rig
from rig.analysis.identification.next_experiment import widths
from rig.errors import UsageError
from rig.record.run import Samples

pytestmark = pytest.mark.slow
COUNT, ROWS = int(os.environ.get("RIGS", "48")), os.environ.get("ROWS", "")
RATE = 5e3


class Plant(NamedTuple):
    """A scene to identify.

    `free`: free keys with their values. `runs`: speed and load of each. `start`: key and value per speed of a start
    that is stuck, so that a cycle is reached where sliding is stable too.
    """

    free: dict[str, float]
    runs: tuple[tuple[float, float], ...]
    output: str
    noise: float
    process_noise: float
    seconds: float
    start: tuple[str, float] | None = None


PLANTS = {
    "belt": Plant(
        free={
            "friction.mu_static": 0.5,
            "friction.mu_dynamic": 0.18,
            "friction.speed_scale": 0.05,
            "body.damping": 2.0,
        },
        runs=((0.05, 16.0), (0.10, 16.0), (0.10, 26.0)),
        output="displacement",
        noise=1e-5,
        process_noise=0.01,
        seconds=6.0,
        start=("start.velocity", 1.0),
    ),
    "pendulum": Plant(
        free={
            "friction.mu_static": 0.5,
            "friction.mu_dynamic": 0.18,
            "friction.speed_scale": 0.05,
            "body.damping": 0.08,
        },
        runs=((0.25, 16.0), (0.50, 16.0), (0.50, 26.0)),
        output="displacement",
        noise=1e-5,
        process_noise=0.01,
        seconds=7.0,
        start=("start.velocity", 0.2),
    ),
    "lever": Plant(  # its period of 1.1 s needs 14 s for ten cycles
        free={
            "friction.mu_static": 0.42,
            "friction.mu_kinetic": 0.25,
            "cylinder.damping": 0.12,
            "friction.decay": 220.0,
        },
        runs=((0.10, 20.0), (0.06, 20.0), (0.10, 28.0)),
        output="arm_displacement",
        noise=5e-6,
        process_noise=0.003,
        seconds=14.0,
        start=("start.angular_velocity", 0.1),
    ),
    "seal_l": Plant(
        free={"friction.mixed_force": 9.7, "friction.decay": 620.0, "body.damping": 3.17, "body.mass": 0.2},
        runs=((0.003, 10.0), (0.0045, 10.0)),
        output="displacement",
        noise=4e-7,
        process_noise=0.0005,
        seconds=3.0,
    ),
    "seal_p": Plant(
        free={"friction.mixed_force": 9.7, "friction.decay": 700.0, "friction.film": 37.9, "body.mass": 0.2},
        runs=((0.003, 10.0), (0.0045, 10.0)),
        output="displacement",
        noise=4e-7,
        process_noise=0.0005,
        seconds=3.0,
    ),
    "belt_c": Plant(
        free={"friction.mu_static": 0.6, "friction.mu_kinetic": 0.25, "body.mass": 5.0},
        runs=((0.05, 16.0), (0.10, 16.0), (0.10, 26.0)),
        output="displacement",
        noise=1e-5,
        process_noise=0.01,
        seconds=6.0,
        start=("start.velocity", 1.0),
    ),
}


def say(*parts):
    sys.stdout.write(" ".join(map(str, parts)) + "\n")
    sys.stdout.flush()


def rows(test, count, compute):
    """What `compute` returns for each of `count` rigs: JSON values, kept in the file ROWS."""
    kept = [json.loads(line) for line in Path(ROWS).read_text().splitlines()] if ROWS and Path(ROWS).exists() else []
    known = {row["rig"]: row for row in kept if row["test"] == test}
    for number in range(count):
        if number not in known:
            known[number] = {"test": test, "rig": number, **compute(number)}
            if ROWS:
                with Path(ROWS).open("a") as file:
                    file.write(json.dumps(known[number]) + "\n")
        say(known[number])
    return [known[number] for number in range(count)]


def drawn(number, law=None, runs=None, spread=0.25, plants=tuple(PLANTS)):
    """Rig `number`: its scene, free keys, truth, recordings. `law`: friction of the truth instead."""
    scene = plants[number % len(plants)]
    free, settings, output, noise, force, seconds, start = PLANTS[scene]
    chance = np.random.default_rng(1000 + number)
    base = rig.load(scene, {"limits": "none"})
    assert set(free) <= base.values().keys()
    made = [{"drive.speed": speed, "load.force": load, "limits": "none"} for speed, load in runs or settings]
    for _ in range(20):  # of some seals sliding is stable at the speeds of the runs: nobody records them
        truth = {key: value * chance.uniform(1.0 - spread, 1.0 + spread) for key, value in free.items()}
        if start or all(rig.limit_cycle(rig.load(scene, truth | values)).found for values in made):
            break
    offset, delay = 100.0 * noise * chance.uniform(-1.0, 1.0), chance.uniform(0.0, 5e-3)
    entries = []
    for k, (speed, load) in enumerate(runs or settings):
        values = {"drive.speed": speed, "load.force": load}
        own = truth if law is None else law(truth)
        own = own | ({start[0]: start[1] * speed} if start else {})
        own |= {f"sensors.{name}.rate": RATE for name in list(base.sensors)[:1]}  # the step of the plant is as short
        made = {**own, **values, "limits": "none", "noise.force": f"{force} N/Hz^0.5", "seed": 100 * number + k}
        run = rig.simulate(replace(rig.load(scene, made), protocol=(), controllers={}), seconds)
        first, *_, last = np.array_split(run.signals[output], 4)
        if np.ptp(last) < 0.2 * np.ptp(first):  # its noise has ended the vibration: nobody records that
            return drawn(number + 48, law, runs, spread, plants)
        t = np.arange(0.5, float(run.time[-1]), 1.0 / RATE)
        v = np.interp(t - delay, run.time, run.signals[output]) + offset + noise * chance.standard_normal(t.size)
        run.measurements["probe"] = Samples(np.rint(t * 1e9).astype(np.int64), v)
        run.units["meas/probe"] = run.units[output]
        columns = {"probe": {"reads": output, "offset": "free"}}
        entries.append({"run": run, "skip": "1 s", "set": values, "columns": columns, "name": f"run{k}"})
    ranges = {key: (0.1 * base.values()[key][0], 10.0 * base.values()[key][0]) for key in free}
    return base, ranges, truth, entries


def deviations(found, truth):
    """(estimate - truth) / sigma of each free parameter, and by how many sigma an interval reaches to each side."""
    C = found.best.covariance
    return [
        math.log(p.value / truth[p.key]) / math.sqrt(C[i, i]) for i, p in enumerate(found.parameters)
    ], found.best.reach


def interval(number):
    base, ranges, truth, entries = drawn(number)
    try:
        found = rig.identify(base, entries, ranges, starts=2)
    except UsageError as fault:
        return {"scene": base.name, "refused": str(fault)[:200], "z": []}
    z, reach = deviations(found, truth)
    return {"scene": base.name, "z": z, "reach": reach, "fits": found.best.fits, "p": found.best.p}


@pytest.mark.timeout(7200)
def test_intervals_hold_and_are_not_biased():
    made = rows("intervals", COUNT, interval)
    z = [value for row in made for value in row["z"]]
    inside = [abs(value) < row["reach"] for row in made for value in row["z"]]
    misfits = sum(not row.get("fits", True) for row in made)
    say(f"{len(z)} intervals, {100 * np.mean(inside):.1f} % hold, mean {np.mean(z):.2f}, {misfits} misfits")
    assert len(z) >= 180 * COUNT / 48
    assert 0.84 <= np.mean(inside) <= 0.97
    assert abs(np.mean(z)) < 0.33
    assert misfits <= math.ceil(5 * COUNT / 48)


def gaussian(truth):
    """A table whose friction falls later than the Stribeck law, by at least three times the noise of the sensor."""
    speeds = np.linspace(0.0, 6.0, 40) * truth["friction.speed_scale"]
    top, low = truth["friction.mu_static"], truth["friction.mu_dynamic"]
    values = low + (top - low) * np.exp(-((speeds / (1.5 * truth["friction.speed_scale"])) ** 2))
    law = {"friction.law": "table", "friction.speeds": speeds.tolist(), "friction.values": values.tolist()}
    return {**law, "body.damping": truth["body.damping"]}


def wrong_law(number):
    base, ranges, _, entries = drawn(number, gaussian, plants=("belt", "pendulum"))
    fit = rig.identify(base, entries, ranges, starts=1)
    assert fit.best.fits or all(math.isnan(p.low) for p in fit.parameters)
    return {"scene": base.name, "fits": fit.best.fits, "p": fit.best.p}


@pytest.mark.timeout(7200)
def test_a_wrong_law_is_a_misfit_and_has_no_interval():
    found = [not row["fits"] for row in rows("wrong law", COUNT, wrong_law)]
    assert sum(found) >= math.floor(45 * COUNT / 48)


@pytest.mark.timeout(7200)
def test_two_loads_identify_what_one_does_not():
    """The base alone, with its repetition, with another load, and with the best of rig identify --next."""
    width = {}
    for name, more in (
        ("alone", ()),
        ("repeated", ((0.05, 16.0),)),
        ("load", ((0.05, 32.0),)),
        ("best", ((0.25, 8.0),)),
    ):
        base, ranges, _, entries = drawn(0, runs=((0.05, 16.0), *more))
        fit = rig.identify(base, entries, ranges, starts=2).best
        width[name] = widths(fit, fit.covariance)
    say(width)
    assert width["best"]["friction.mu_dynamic"] < 0.12
    assert width["best"]["body.damping"] < 0.12
    assert width["load"]["friction.mu_dynamic"] < 0.05
    for one_load in ("alone", "repeated"):
        assert width[one_load]["friction.mu_dynamic"] > 3.0 * width["best"]["friction.mu_dynamic"]


def proposed(number):
    base, ranges, _, entries = drawn(number, plants=("belt",), runs=((0.05, 16.0), (0.10, 26.0)))
    over = {"drive.speed": [0.05, 0.1, 0.2], "load.force": [8.0, 32.0]}
    found = rig.identify(base, entries, ranges, starts=1, next=over)
    best = found.proposals[0]
    at = tuple(best.settings[key][0] for key in ("drive.speed", "load.force"))
    *_, again = drawn(number, plants=("belt",), runs=((0.05, 16.0), (0.10, 26.0), at))
    fit = rig.identify(base, again, ranges, starts=1).best
    now = widths(fit, fit.covariance)
    ratio = math.exp(np.mean([math.log(now[key] / best.widths[key]) for key in now]))
    return {"at": at, "found over predicted": ratio}


@pytest.mark.timeout(7200)
def test_the_proposed_experiment_narrows_the_intervals_as_predicted():
    count = max(20 * COUNT // 48, 2)
    good = sum(0.7 <= row["found over predicted"] <= 1.4 for row in rows("next", count, proposed))
    assert good >= math.floor(18 * count / 20)
