"""The maps beside the sliders of the opening: each slider reaches quiet and vibration, or the page says why not."""

import json
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import rig
from rig.analysis.linear.eigenvalue_curves import equilibrium, none
from rig.web.app import PAGE
from rig.web.form import form

MAPS = json.loads((PAGE / "slider_maps.json").read_text(encoding="utf-8"))
OPENING = (PAGE / "panes" / "opening.js").read_text(encoding="utf-8")
UNDAMPED = {"four_dof"}
"""No vibration of it dies: a run does not tell which values are quiet."""
QUIET, VIBRATING = {"I", "stable"}, {"III", "unstable"}


def middles(entry):
    """(value in the middle of each span, region)."""
    ends = [entry["low"], *(end for end, _ in entry["spans"])]
    return [(0.5 * (a + b), region) for (a, b), (_, region) in zip(pairwise(ends), entry["spans"])]


def grows(scene, key, value, others):
    """Whether a small vibration about steady sliding grows at a value; None where nothing slides steadily."""
    if key.startswith("controllers."):
        rates = rig.sweep(scene, key, [value, 1.001 * value], key.split(".")[1]).rates[0]
    else:
        rates = equilibrium(rig.load(scene, {**others, key: value})).rates
    return bool((rates.real > none(rates)).any()) if len(rates) else None


def test_every_scene_of_the_opening_has_maps():
    first = re.findall(r'FIRST = "(\w+)"', OPENING)
    assert set(MAPS) == {*first, *re.findall(r"^    (\w+): \[t\(", OPENING, flags=re.MULTILINE)}


@pytest.mark.parametrize("scene", MAPS)
def test_each_slider_has_a_map_that_eigenvalues_confirm(scene):
    shown = form(rig.load(scene))
    entries = {one["key"]: one for table in shown["sections"] for one in table["values"]}
    sliders = {key for key in shown["hands"] if key in entries and entries[key]["slider"]}
    assert set(MAPS[scene]) == sliders
    for key, entry in MAPS[scene].items():
        assert entry["low"] <= entries[key]["value"] <= entry["high"] or entry["at"] != entries[key]["value"]
        for value, region in middles(entry):
            seen = grows(scene, key, value, entry["with"] or {})
            assert region not in QUIET or seen is not True, (key, value)
            assert region not in VIBRATING or seen is not False, (key, value)


def amplitudes(scene, changes):
    """Half of peak to peak of the velocity, else of the first output, in the third and in the last fifth of a run.

    The plant runs alone with values that are held: no controller acts, and no step of the protocol moves a value.
    """
    alone = replace(rig.load(scene, changes), protocol=(), controllers={})
    run = rig.simulate(alone, duration=20.0)
    signal = run.signals["velocity" if "velocity" in run.signals else next(iter(run.signals))]
    parts = np.array_split(signal, 5)
    return tuple(0.5 * float(np.ptp(parts[which])) for which in (2, 4))


@pytest.mark.slow
@pytest.mark.parametrize("scene", [scene for scene in MAPS if scene not in UNDAMPED])
def test_a_run_is_quiet_and_vibrates_where_the_map_says_so(scene):
    """The first slider that decides it: one simulation dies out, the other keeps vibrating, evenly or in beats."""
    for key, entry in MAPS[scene].items():
        values = {region: value for value, region in middles(entry)}
        quiet, moving = values.keys() & QUIET, values.keys() & VIBRATING
        if quiet and moving and not key.startswith("controllers."):
            break
    else:
        pytest.skip("no slider of this scene decides it alone: the page says so")
    changes = entry["with"] or {}
    calm, stirred = (amplitudes(scene, {**changes, key: values[kind.pop()]}) for kind in (quiet, moving))
    assert stirred[1] > 0.5 * stirred[0]
    assert calm[1] < max(0.5 * calm[0], 1e-6 * stirred[1])
