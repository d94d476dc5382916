"""A part is one file: no other module knows a plant, an effect or a kind of controller by its name.

What a module needs of a part the part declares: rig.about (effects), rig.picture (plants),
rig.controllers.blocks.design (controllers).
"""

import ast
import re
from pathlib import Path

from rig import controllers
from rig.plants import PLANTS
from rig.scenes.variants import optional

ROOT = Path(__file__).parent.parent
WORDS = {
    "drive",
    "load",
    "friction",
    "noise",
    "disc",
    "slope",
    "film",
    "slider",
    "normal_force",
    "c",
    "fmu",
    "structure",
}
"""Names of parts that are words of other rooms too: quantities, steps of a protocol, terms of the energy balance."""
KNOWN = {
    "rig/cli/runs.py": {"pendulum"},  # the scene of `rig demo`
    "rig/scenes/shipped.py": {"pendulum"},  # the scene to start from
    "rig/design/rig.py": {"dither"},  # scales of a command are those without dither
    "rig/analysis/cycles/floquet.py": {"dither"},  # the motion under dither that is not fast
    "rig/analysis/identification/lever.py": {"lever"},  # the experiments that identify this rig
    "rig/analysis/map/dither.py": {"dither"},  # friction averaged over dither, an analysis of its own
    "rig/analysis/map/job.py": {"dither"},
    "rig/analysis/linear/modes.py": {"dither"},
    "rig/analysis/linear/modes_report.py": {"dither"},  # a key of its JSON
    "rig/analysis/linear/regions.py": {"dither"},
    "rig/structure/full.py": {"piezo"},  # the places of a stack on a mesh, as the scene names them
    "rig/view/lever.py": {"lever"},  # drawers that a plant names
    "rig/view/plate.py": {"plate", "foam"},
}
"""Modules that may name parts, with the reason."""
APART = ("rig/plants/", "rig/effects/", "rig/papers/", "rig/qualify/torture/")
"""Parts themselves, and rooms that are about certain scenes."""


def parts(shipped):
    effects = {one.key for scene in shipped for one in optional(scene.parameters) if "." not in one.key}
    return {*PLANTS.shipped, *controllers.KINDS.shipped, *effects} - WORDS


def texts(code):
    """Texts of a module that are no docstrings: the names in them, a key by its first word."""
    tree = ast.parse(code)
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docs = {
        id(n.body[0].value) for n in ast.walk(tree) if isinstance(n, documented) and isinstance(n.body[0], ast.Expr)
    }
    found = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and id(n) not in docs]
    return {text.partition(".")[0] for text in found if isinstance(text, str) and " " not in text}


def test_no_module_but_its_own_knows_a_part_by_name(shipped):
    known, found = parts(shipped), {}
    quoted = re.compile(rf"[\"'](?:{'|'.join(known)})\b")  # which modules are looked at closely
    for path in (ROOT / "rig").rglob("*.py"):
        where, code = path.relative_to(ROOT).as_posix(), path.read_text()
        if where.startswith(APART) or path.parent.name in ("controllers", "sensors") or not quoted.search(code):
            continue
        if named := texts(code) & known - KNOWN.get(where, set()):
            found[where] = sorted(named)
    assert found == {}


def test_every_plant_has_parameters_and_rows():
    for plant in PLANTS.shipped:
        module = PLANTS[plant]
        assert callable(module.assemble), plant
        assert "noise" in module.Parameters.model_fields, plant
