"""Make rig/web/page/slider_maps.json: what a rig of the page's opening does over the range of each of its sliders.

make slidermaps, or for some of them: python docs/page_slider_maps.py SCENE ...
"""

import json
import re
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

import rig
from rig.analysis.linear.eigenvalue_curves import none
from rig.analysis.map.result import REGIONS
from rig.errors import RigError
from rig.web.form import form

PAGE = Path(__file__).parents[1] / "rig" / "web" / "page"
FILE = PAGE / "slider_maps.json"
COUNT, FEWER = 33, {"tip": 9}
"""Values of one slider, fewer of scenes that take long; where the kind of motion changes is located between them."""
WITH = {r"shunt\.(resistance|inductance)": {"shunt.connected": "1"}}
"""A value, by a pattern of its key, that acts only with others."""
LINEAR = {"four_dof", "brake", "brake_shunt", "plate", "disc_slider"}
"""Scenes whose maps tell by eigenvalues where sliding is stable: no vibration of the first one dies, so that runs do
not tell sliding from vibration, and a run of the others takes minutes."""
BURSTS = {"plate"}
"""Scenes that leave sliding whose small vibrations die: the plate bursts at friction.mu 0.23 and 0.3, not at 0.15."""
HELD = {"tip": {"drive.speed": 0.06}}
"""Values of a scene whose protocol begins at rest, for the maps of the others."""


def opening():
    """The scenes of the opening, as its module lists them."""
    text = (PAGE / "panes" / "opening.js").read_text(encoding="utf-8")
    first = re.search(r'FIRST = "(\w+)"', text)[1]
    listed = re.findall(r"^    (\w+): \[t\(", text, flags=re.MULTILINE)
    return list(dict.fromkeys([first, *listed]))


def mapped(name):
    """The map of each slider of a scene, by key."""
    shown = form(rig.load(name))
    entries = {one["key"]: one for table in shown["sections"] for one in table["values"]}
    sliders = {key: entries[key]["slider"] for key in shown["hands"] if key in entries and entries[key]["slider"]}
    values = {**{key: one["value"] for key, one in entries.items()}, **HELD.get(name, {})}
    return {key: {**of_slider(name, key, one["low"], one["high"]), "at": values[key]} for key, one in sliders.items()}


def of_slider(name, key, low, high):
    """The ends of a slider, and spans of its range, each with its upper end and what the rig does there (`REGIONS`)."""
    changes = {**HELD.get(name, {}), **next((more for pattern, more in WITH.items() if re.fullmatch(pattern, key)), {})}
    changes.pop(key, None)
    low, high = possible(name, key, changes, low, high)
    controller = key.split(".")[1] if key.startswith("controllers.") else ""
    linear = controller or name in LINEAR
    scene = rig.load(name, changes)
    spans = by_eigenvalues(scene, key, controller, low, high) if linear else by_runs(scene, key, low, high)
    return {"low": rounded(low), "high": rounded(high), "spans": joined(spans, high), "with": changes or None}


def possible(name, key, changes, low, high):
    """The part of a range in which the scene can be made: friction at rest, for one, is not below that in motion."""
    grid = np.linspace(low, high, 201)
    allowed = [value for value in grid.tolist() if can_be(name, {**changes, key: repr(value)})]
    return allowed[0], allowed[-1]


def can_be(name, changes):
    """Whether the scene has an assembly with these values."""
    try:
        rig.load(name, changes).assemble().system()
    except RigError:
        return False
    return True


def by_runs(scene, key, low, high):
    """(upper end, region) by the map of the rig: four runs at each value, and located ends of the vibration."""
    with tempfile.TemporaryDirectory() as folder:
        over = f"{key}={low!r}:{high!r}:{FEWER.get(scene.name, COUNT)}"
        made = rig.map(scene, over, out=folder, workers=1)
    x = made.job.x.values
    rates = rig.sweep(scene, key, x).rates
    regions = [settled(region, of_value) for region, of_value in zip(made.regions[0], rates)]
    borders = np.sort(np.concatenate([made.onsets[0], np.nanmean(made.ends[:, 0], axis=1)]))
    for (a, before), (b, after) in pairwise(zip(x, regions)):
        if before != after:
            between = borders[(borders >= a) & (borders <= b)]
            yield float(between[0]) if between.size else 0.5 * (a + b), REGIONS[before]
    yield high, REGIONS[regions[-1]]


def settled(region, rates):
    """The region of a value by runs; where they leave sliding whose small vibrations die, the past decides."""
    known = rates[np.isfinite(rates)]
    dies = known.size > 0 and not (known.real > none(known)).any()
    return REGIONS.index("II") if dies and REGIONS[region] == "III" else region


def by_eigenvalues(scene, key, controller, low, high):
    """(upper end, region) by the eigenvalues of sliding, with a controller those of the closed loop."""
    swept = rig.sweep(scene, key, np.linspace(low, high, COUNT), controller)
    inner = [critical.value for critical in swept.critical if low < critical.value < high]
    for a, b in pairwise([low, *inner, high]):
        inside = rig.sweep(scene, key, np.linspace(a, b, 3), controller)
        rates = inside.rates[1][np.isfinite(inside.rates[1])]
        calm = "II" if scene.name in BURSTS else "stable"
        yield b, "unstable" if (rates.real > none(rates)).any() else calm


def joined(spans, high):
    """Spans with neighbours of the same region put together."""
    made = []
    for end, region in spans:
        if made and made[-1][1] == region:
            made.pop()
        made.append([rounded(end), region])
    made[-1][0] = rounded(high)
    return made


def rounded(value):
    """Four digits."""
    return float(f"{value:.4g}")


if __name__ == "__main__":
    known = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    for scene in sys.argv[1:] or opening():
        known[scene] = mapped(scene)
        sys.stdout.write(f"{scene} {json.dumps(known[scene])}\n")
        text = ",\n".join(f"{json.dumps(one)}: {json.dumps(known[one])}" for one in opening() if one in known)
        FILE.write_text(f"{{\n{text}\n}}\n", encoding="utf-8")
