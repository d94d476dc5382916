"""Only the effects that a scene calls for: an absent one adds nothing, one of size zero changes nothing."""

from dataclasses import replace

import numpy as np
import pytest

import rig
from benchmarks import absent as twin
from rig.bench.run.rig_comparison import Comparison, VisitedState
from rig.errors import RigError
from rig.scenes import names
from rig.scenes.shipped import card
from rig.scenes.variants import absent, added, dropped, without, without_none
from rig.stability.report import mode_sets

NONE = {
    "dither": {"amplitude": 0.0},
    "inhomogeneity": {"depth": 1e-15},
    "noise": {"force": 0.0},
    "piezo": {"coupling": 1e-12},
    "shunt": {"kind": "open"},
    "tuned_mass": {"mass": 1e-15, "stiffness": 1e-15, "damping": 0.0, "damping_ratio": None},
}
"""The values at which an effect is none. Others have none: a bent disc is in place of a stiff one, an amplifier that
gives no voltage is a short circuit, a lag of no time is no state."""
PLANT_OF = {name: card(name)["plant"] for name in names()}
PLANT_SCENES = {PLANT_OF[name]: name for name in reversed(names())}
CASES = [(plant, name) for plant in PLANT_SCENES for name in names() if PLANT_OF[name] == plant]


def variants(scene):
    """(effect, the scene with it, the scene without it), of all effects that the scene can be with or without."""
    for name, keys in dropped(scene).items():
        try:
            yield name, scene, without(scene, keys)
        except RigError:
            continue
    for name, keys in absent(scene).items():
        try:
            yield name, added(scene, keys)[0], scene
        except RigError:
            continue


def visited(scene, system, like):
    """States in every mode set that is looked at before a run: bodies anywhere, all else as at the start."""
    draw = np.random.default_rng(3)
    nq = len(system.coordinates)
    moved = [i for i in range(2 * nq) if system.names[i] in like.names]
    for key in mode_sets(system):
        x = system.start.copy()
        x[moved] += 1e-3 * draw.normal(size=len(moved))
        yield VisitedState(system, key, x, scene)


@pytest.mark.parametrize("plant", PLANT_SCENES)
def test_an_absent_effect_adds_no_state_no_row_no_mode_and_leaves_its_neighbours(plant):
    """With it there are its own; without it the rig is what it would be had nobody thought of the effect.

    What other effects drive by themselves, rates of network and signals, is the same with it and without it.
    """
    for name, more, less in variants(rig.load(PLANT_SCENES[plant])):
        big, small = more.assemble(), less.assemble()
        assert not [state for state, owner in small.owners.items() if owner == name], name
        assert set(small.names) - set(big.names) == set() or name == "disc_modes", name
        assert small.system().keys <= big.system().keys, name
        if name in ("piezo", "shunt", "amplifier") or name.endswith((" lag", " limits")):
            continue  # one pair of electrodes; lag and clamp stand between a command and the rig
        rates = [{**a.network, **a.signals} for a in (big, small)]
        for state in rates[0].keys() & rates[1].keys():
            assert rates[0][state] == rates[1][state], (name, state)


@pytest.mark.parametrize("scene", sorted({name for _, name in CASES}))
def test_an_effect_of_size_zero_is_none(scene):
    """Accelerations, rates and contact forces agree to 1e-12 of their terms, in every mode set."""
    loaded = rig.load(scene)
    for name in dropped(loaded):
        zero = NONE.get(name)
        if zero is None:
            continue
        raw = loaded.parameters.model_dump()
        raw[name] = zero if "kind" in zero else {**raw[name], **{k: v for k, v in zero.items() if k in raw[name]}}
        parameters = type(loaded.parameters).model_validate(without_none(raw))
        system = replace(loaded, parameters=parameters, controllers={}, protocol=()).assemble().system()
        try:
            bare = replace(loaded, controllers={}, protocol=())
            other = without(bare, [name]).assemble().system()
        except RigError:
            continue
        assert Comparison([*visited(loaded, system, other)]).share(lambda _, other=other: (other, {})) <= 1e-12, name


def test_the_kernel_has_no_instruction_for_what_is_absent():
    """Products are all that kernels have code for; without them it is that of a source that never knew of them."""
    kinds = twin.kinds(twin.slipping())
    own, bare = (twin.instructions(one, *kinds) for one in twin.compiled_loops())
    assert len(own) > 100
    assert own == bare
