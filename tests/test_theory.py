"""The pages of docs/theory: closed forms that they state, evaluated against the program; what each part has there."""

import math
import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import rig
from rig.analysis.cycles.cycle import limit_cycle
from rig.controllers import KINDS as CONTROLLERS
from rig.laws import LAWS as FRICTION
from rig.model.formulation import assemble
from rig.plants import PLANTS
from rig.sensors import KINDS as SENSORS
from rig.solve.records import STICK

DOCS = Path(__file__).parents[1] / "docs"
THEORY = DOCS / "theory"
LAWS = FRICTION.shipped


def growth(scene, changes):
    return max(mode.growth for mode in rig.modes(rig.load(scene, changes)).sliding.modes)


def test_the_landing_projection_is_mass_weighted():
    """eq-landing, on a rig whose mass matrix is not diagonal."""
    system = rig.load("belt_tuned_mass").assemble().system()
    nq = len(system.coordinates)
    direction = np.array([patch.direction for patch in system.patches]).T
    pushed = np.linalg.solve(system.mass, direction)
    own = -system.slip_rows[:, nq : 2 * nq]
    expected = np.eye(system.n)
    expected[nq : 2 * nq] += pushed @ np.linalg.solve(own @ pushed, system.slip_rows)
    landing = assemble(system, system.key([STICK], [0], [])).landing
    assert landing == pytest.approx(expected, abs=1e-15)
    assert np.abs(system.slip_rows @ landing).max() < 1e-15
    assert not np.allclose(landing[nq + 1], np.eye(system.n)[nq + 1])  # the absorber takes part


def test_cycle_of_the_mass_on_a_belt_with_coulomb_friction():
    """eq-belt-cycle."""
    scene = rig.load("belt_c")
    p = scene.parameters
    assert p.body.damping == 0.0
    omega, v = math.sqrt(p.body.stiffness / p.body.mass), p.drive.speed
    a = (p.friction.mu_static - p.friction.mu_kinetic) * p.load.force / p.body.stiffness
    b = v / omega
    stick, slip = 2.0 * a / v, (2.0 * math.pi - 2.0 * math.atan(a / b)) / omega
    cycle = limit_cycle(scene)
    assert cycle.stick_time["contact"] == pytest.approx(stick, rel=1e-12)
    assert cycle.period == pytest.approx(stick + slip, rel=1e-12)
    reach = math.hypot(a, b)
    assert min(cycle.extremes["velocity"]) == pytest.approx(-omega * reach, rel=1e-9)
    top = p.friction.mu_kinetic * p.load.force / p.body.stiffness + reach
    assert max(cycle.extremes["displacement"]) == pytest.approx(top, rel=1e-9)


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_tread_block_flutters_beyond_the_coalescence(share):
    """eq-tread-flutter."""
    free = {"tip.tangential_damping": 0.0, "tip.normal_damping": 0.0}
    p = rig.load("tread", free).parameters
    cx, cz, cxz, cc = p.tip.tangential_stiffness, p.tip.normal_stiffness, p.tip.coupling, p.contact.stiffness
    critical = ((cx - cz - cc) ** 2 / (4.0 * cxz) + cxz) / cc
    found = growth("tread", free | {"friction.law": "constant", "friction.mu": share * critical})
    assert (found > 1e-3) == (share > 1.0)


def test_a_tip_in_sliding_is_stiffer_and_pressed_less():
    """eq-tip-sliding."""
    changes = {"friction.law": "constant", "friction.mu": 0.3, "tip.damping": 0.0, "tip.retardation": 0.0}
    changes |= {"waviness": "none", "drive.speed": 0.1}
    scene = rig.load("tip", changes)
    tip, mu = scene.parameters.at_fixed_height, 0.3
    assert tip.relief > 0.0
    (mode,) = rig.modes(scene).sliding.modes
    omega = math.sqrt((1.0 + tip.relief * mu) * tip.stiffness / tip.mass)
    assert 2.0 * math.pi * mode.frequency == pytest.approx(omega, rel=1e-9)


def sections(page):
    """Heading -> text of each section of a page."""
    parts = re.split(r"^## (.+)\n", (THEORY / page).read_text(), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2]))


def tables_of_effects(section=None):
    """The tables of a scene that are those of effects, of all plants."""
    if section is None:
        return {"noise"}.union(*(tables_of_effects(PLANTS[plant].Parameters) for plant in PLANTS.shipped))
    found = set()
    for name, info in section.model_fields.items():
        for kind in get_args(info.annotation) or (info.annotation,):
            if getattr(kind, "__module__", "").startswith("rig.effects") and hasattr(kind, "model_fields"):
                found.add(name)
    return found


@pytest.mark.parametrize(
    ("page", "named"),
    [("plants.md", f"{{image}} {plant}.svg\n") for plant in PLANTS.shipped]
    + [("effects.md", f"`[{name}]`") for name in sorted(tables_of_effects() - {"friction"})]  # laws: in laws.md
    + [("controllers.md", f"`{kind}`") for kind in CONTROLLERS.shipped],
)
def test_a_part_has_its_equations_and_its_source(page, named):
    found = [text for text in sections(page).values() if named in text]
    assert any(("$$ (eq-" in text or "{eq}" in text) and "Source: " in text for text in found)


@pytest.mark.parametrize("law", LAWS)
def test_a_friction_law_has_its_formula(law):
    with_memory = [text for text in sections("memory.md").values() if text.lstrip().startswith(f"`{law}`. ")]
    over_speed = (DOCS / "laws.md").read_text().partition("## The laws")[2].partition("internal states")[0]
    row = f"\n| `{law}` | " in over_speed  # its formula is evaluated in tests/test_docs.py
    assert row or ["$$ (eq-" in text and "Source: " in text for text in with_memory] == [True]


@pytest.mark.parametrize("kind", [*SENSORS.shipped])
def test_an_instrument_has_its_front_end_and_the_source_of_its_values(kind):
    text = sections("instruments.md")["The instruments"]
    [row] = re.findall(rf"^\| {kind.replace('_', ' ')} \|(.*)\|$", text, re.MULTILINE)
    assert [bool(cell.strip()) for cell in row.split(" | ")] == [True] * 4
