"""Scenes that were damaged at random: each is refused with a SceneError that names the key, or holds."""

import copy
import json
import math
import random
import signal
import tomllib
from contextlib import suppress

from rig import scenes
from rig.design import numbers
from rig.errors import RigError, SceneError
from rig.model.method import chosen
from rig.scenes.explain import explain
from rig.scenes.scene import Scene
from rig.scenes.shipped import HERE
from rig.stability.report import stability_report

SECONDS = 30
"""In which every one of them must be judged."""
ODD = (
    1e300,
    -1e300,
    math.inf,
    math.nan,
    0,
    -1.0,
    2**63,
    True,
    [],
    {},
    {"a": 1},
    [1, 2],
    ["5 kg", "paper"],
    ["5 kg", "papr"],
    "",
    "none",
    "nan",
    "5 kg",
    "1 ns",
    "1e300 s",
    "5 furlong",
    "1 m**m**m",
    "1,5 kg",
    "forever",
    "belt",
    [1.0] * 5000,
    {"kind": []},
    {"law": "table"},
    {"step": "hold"},
    [{"step": []}],
    [{"step": "repeat"}],
)


def toml(value):
    """A value as it stands in a TOML file; None has no place in one, an empty text is the nearest."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(key))} = {toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value)
    return str(value) if isinstance(value, int) else json.dumps("" if value is None else value)


def places(tree, path=()):
    """Path of everything in a tree."""
    if path:
        yield path
    inside = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in inside:
        yield from places(value, (*path, key))


def at(tree, path):
    for key in path:
        tree = tree[key]
    return tree


def damaged(draw, text):
    """The text of a scene with one to three things wrong."""
    tree = tomllib.loads(text)
    for _ in range(draw.choice((1, 1, 1, 2, 3))):
        *parents, last = draw.choice(list(places(tree)))
        table, what = at(tree, parents), draw.randrange(7)
        if what < 4:
            table[last] = copy.deepcopy(draw.choice(ODD))  # else a list of ODD may come to hold itself
        elif what == 4 and isinstance(table, dict):
            table[draw.choice(("kind", "law", "extra", "", "a.b", "step", "x" * 300, "é"))] = table.pop(last)
        elif what == 5:
            table[last] = copy.deepcopy(at(tree, draw.choice(list(places(tree)))))
        else:
            del table[last]
        if not list(places(tree)):
            break
    return "\n".join(f"{json.dumps(key)} = {toml(value)}" for key, value in tree.items())


def read(path):
    """A scene, or its faults."""
    try:
        return scenes.load(path), ()
    except SceneError as error:
        return None, error.faults


def told_well(faults):
    return 0 < len(faults) <= 101 and all(one.strip() and "\n" not in one and len(one) < 1000 for one in faults)


def give_up(*_):
    raise AssertionError(f"not judged within {SECONDS} s")


def judge(path):
    """The scene of a file as it was read, None where it is refused in words."""
    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(SECONDS)
    try:
        scene, faults = read(path)
        if scene is None:
            assert told_well(faults), faults
            return None
        explain(scene)
        system = scene.assemble().system()
        stability_report(system, chosen(scene.clock.method, system), scene.step_ns * 1e-9, 1)
        with suppress(RigError):  # a controller that cannot be designed
            numbers(scene)
        assert Scene.from_json(scene.to_json()).digest == scene.digest
        for key, (value, _) in scene.values().items():
            for one in value if isinstance(value, list) else [value]:
                if isinstance(one, float | int):
                    assert abs(one) <= 1e15, f"{key} = {one} was accepted"
        return scene
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def test_a_damaged_scene_is_refused_in_words_or_holds(tmp_path):
    draw, refused = random.Random(1), 0
    texts = [path.read_text() for path in sorted(HERE.glob("*.toml"))]
    path = tmp_path / "mine.toml"
    for _ in range(100):
        path.write_text(damaged(draw, draw.choice(texts)))
        refused += judge(path) is None
    assert refused > 50, "most of them are refused, else nothing was tried"
