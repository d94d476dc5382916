"""Random products of every level beside a plain evaluation of the equations, and their slopes beside differences."""

import numpy as np
import pytest

from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.model.formulation import assemble
from rig.motion.motion import Motion
from rig.solve.records import CLOSED, SLIP_MINUS, SLIP_PLUS, STICK
from rig.stability.linearisation import inputs, own_law

NAMES = ("a", "b", "c")  # seven states, as the lever rig: compiled once for both
SIGN = {SLIP_PLUS: 1.0, SLIP_MINUS: -1.0}


def random_rig(seed):
    """Three masses, two contacts along a and b with two and one normal forces, eight products.

    Products of forces push c only: what a stuck contact needs does not depend on them.
    """
    rng = np.random.default_rng(seed)
    A = Assembly(f"seed {seed}")
    for name in NAMES:
        A.coordinate(name, rng.uniform(0.5, 2.0), rng.uniform(0.1, 1.0), rng.uniform(50.0, 100.0))

    def states():
        return {str(name): rng.normal() for name in rng.choice(NAMES, 2, replace=False)}

    def factor(kinds):
        kind = rng.choice(kinds)
        if kind == "state":
            return str(rng.choice([*NAMES, *(f"{name}'" for name in NAMES)]))
        if kind in ("sin", "cos-1"):
            return str(kind), states()
        return f"N:n{rng.integers(3)}" if kind == "N" else f"T:{'pq'[rng.integers(2)]}"

    parts = {}
    for j in range(8):
        kinds = ("state", "sin", "cos-1", *("N" if j > 2 else ()), *("T" if j > 5 else ()))
        parts[f"P{j}"] = [factor(kinds) for _ in range(rng.integers(1, 4))]
    for j in rng.permutation(8):
        A.product(f"P{j}", *parts[f"P{j}"])
    for patch, name, law in (
        ("p", "a", friction_law.stribeck(0.5, 0.3, 0.1)),
        ("q", "b", friction_law.coulomb(0.6, 0.4)),
    ):
        A.patch(patch, {name: rng.uniform(0.5, 1.5)}, {"one": rng.uniform(0.2, 0.5)}, law)
    for k, patch in enumerate("ppq"):
        pressed = {"one": rng.uniform(5.0, 9.0), **states(), f"P{rng.integers(3)}": rng.normal()}
        A.normal(f"n{k}", patch, pressed, states())
    for name in NAMES:
        last = 3 if name in ("a", "b") else 8
        A.push(name, {f"P{rng.integers(last)}": rng.normal(), "one": rng.normal()})
    return A, parts


def plain(A, parts, modes, x):
    """Products, normal and friction forces, accelerations, by solving the structure's equations as they are written."""
    at = dict(zip(A.names, x))
    known = dict(at)

    def row(entries):
        return sum(value * known[name] for name, value in entries.items())

    def value(factor):
        if isinstance(factor, str):
            return known[factor]
        return np.sin(row(factor[1])) if factor[0] == "sin" else np.cos(row(factor[1])) - 1.0

    def multiply(letters):
        for name, factors in parts.items():
            needs = {f[0] for f in factors if isinstance(f, str) and ":" in f}
            if name not in known and needs <= letters:
                known[name] = float(np.prod([value(factor) for factor in factors]))

    patch_modes, normal_modes = modes[:2]
    multiply(set())
    for (name, _, pressed, *_), mode in zip(A.normals, normal_modes):
        known[f"N:{name}"] = row(pressed) if mode == CLOSED else 0.0
    multiply({"N"})
    stuck = []
    for (name, direction, surface, law, _), mode in zip(A.patches, patch_modes):
        N = sum(known[f"N:{normal[0]}"] for normal in A.normals if normal[1] == name)
        loaded = any(k[1] == name and m == CLOSED for k, m in zip(A.normals, normal_modes))
        w = row(surface) - sum(t * at[f"{c}'"] for c, t in direction.items())
        known[f"w:{name}"] = w
        if mode == STICK and loaded:
            stuck.append((name, direction))
            known[f"T:{name}"] = 0.0
        else:
            known[f"T:{name}"] = SIGN[mode] * law.mu(SIGN[mode] * w) * N if loaded else 0.0

    def accelerations():
        multiply({"N", "T"})
        force = {c: row(A.force.get(c, {})) - A.stiffness[c, c] * at[c] - A.damping[c, c] * at[f"{c}'"] for c in NAMES}
        for name, direction, *_ in A.patches:
            for c, t in direction.items():
                force[c] += t * known[f"T:{name}"]
        for normal in A.normals:
            for c, t in normal[3].items():
                force[c] += t * known[f"N:{normal[0]}"]
        return {c: force[c] / A.mass[c, c] for c in NAMES}

    later = {name for name in parts if name not in known}
    for name, direction in stuck:  # constant surface speed: the body's acceleration along the contact is zero
        for product in later:
            known[product] = 0.0
        [(c, t)] = direction.items()
        known[f"T:{name}"] = -accelerations()[c] * A.mass[c, c] / t
    for product in later:
        known.pop(product, None)
    return known | {f"{c}''": a for c, a in accelerations().items()}


@pytest.mark.parametrize("seed", range(8))
def test_kernels_evaluate_what_the_equations_say(seed):
    A, parts = random_rig(seed)
    system = A.system()
    asked = [*parts, "T:p", "T:q", "N:n0", "N:n1", "N:n2", "w:p", "w:q", *(f"{c}''" for c in NAMES)]
    motion = Motion(system, 1_000_000, "dopri5", outputs=[{name: 1.0} for name in asked])
    rng = np.random.default_rng(seed)
    for _ in range(6):
        key = system.key(rng.integers(3, size=2), rng.integers(2, size=3), ())
        if motion.mode_sets.tables.mode_set_of[key] < 0:
            motion.mode_sets.add(key)
        x = np.append(rng.uniform(-0.2, 0.2, 6), 1.0)
        motion.work.T[:] = np.nan  # as a trial step that overflowed leaves it
        found = motion.outputs_at(x[None], motion.mode_sets.tables.mode_set_of[[key]].astype(np.int64))[0]
        expected = plain(A, parts, system.modes(key), x)
        assert dict(zip(asked, found)) == pytest.approx({name: expected[name] for name in asked}, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_slopes_are_those_of_the_equations(seed, input_slopes):
    A, parts = random_rig(seed)
    system = A.system()
    rng = np.random.default_rng(seed)
    key = system.key([SLIP_PLUS, rng.integers(3)], [CLOSED, rng.integers(2), CLOSED], ())
    modes = assemble(system, key)
    law = own_law(system, modes)
    x = np.append(rng.uniform(-0.1, 0.1, 6), 1.0)

    def rate(y):
        return modes.A @ y + modes.b @ inputs(system, modes, y, law)[0]

    slopes = modes.A + modes.b @ inputs(system, modes, x, law)[1]
    expected = plain(A, parts, system.modes(key), x)
    assert rate(x)[3:6] == pytest.approx([expected[f"{c}''"] for c in NAMES], rel=1e-12, abs=1e-12)
    for j in range(len(x) - 1):
        h = 1e-5 * np.eye(7)[j]
        assert slopes[:, j] == pytest.approx((rate(x + h) - rate(x - h)) / 2e-5, rel=1e-7, abs=1e-6)
    assert input_slopes(system, key, x) == pytest.approx(inputs(system, modes, x, law)[1], rel=1e-11, abs=1e-12)
