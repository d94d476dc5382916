"""Random systems of several contacts: the same events at coarse and fine steps, and contacts that obey their laws."""

import numpy as np
import pytest

from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.model.formulation import assemble
from rig.solve.records import OPEN, STICK

COARSE, FINE, DURATION = 4.0, 0.2, 1.0  # ms, ms, s
NQ = 3
TOUCHING, OPENING, INERTIA = "two contacts", "two that open", "three that open and bear inertia"


def random_system(seed, kind):
    """Three masses coupled by random springs and dampers; contacts in random directions on belts of random speed."""
    rng = np.random.default_rng(seed)
    names = [f"q{i}" for i in range(NQ)]
    a = Assembly(f"{kind}, seed {seed}")
    for name in names:
        a.coordinate(name, rng.uniform(0.5, 2.0))
    B = rng.normal(size=(NQ, NQ))
    K = (B @ B.T + NQ * np.eye(NQ)) * rng.uniform(100.0, 500.0)
    D = K * rng.uniform(1e-4, 2e-3)
    for i, first in enumerate(names):
        for j, second in enumerate(names):
            a.stiffness[first, second], a.damping[first, second] = K[i, j], D[i, j]
        a.start |= {first: rng.uniform(-0.01, 0.01), f"{first}'": rng.uniform(-0.2, 0.2)}
    for p in range(3 if kind == INERTIA else 2):
        along, normal = (v / np.linalg.norm(v) for v in rng.normal(size=(2, NQ)))
        kinetic = rng.uniform(0.1, 0.5)
        law = friction_law.coulomb(kinetic * rng.uniform(1.0, 1.6), kinetic)
        a.patch(f"contact {p}", dict(zip(names, along)), {"one": rng.uniform(-0.3, 0.3)}, law)
        load = rng.uniform(1.0, 5.0)
        row, direction, inertia = {"one": load}, {}, {}
        if kind != TOUCHING:  # presses along `normal` through a stiffness; preloaded, so that it rests at q = 0
            row |= dict(zip(names, -rng.uniform(200.0, 2000.0) * normal))
            direction = dict(zip(names, normal))
            for name, n in direction.items():
                a.push(name, {"one": -load * n})
        if kind == INERTIA:
            inertia = dict(zip(names, rng.uniform(-0.3, 0.3, NQ)))
        a.normal(f"load {p}", f"contact {p}", row, direction, inertia)
    return a.system()


def least_inertia(system):
    """The smallest det(Me)/det(M) of all mode sets: near zero it jams."""
    return (
        min(assemble(system, key).jam for key in range(system.keys))
        if any(np.any(k.inertia) for k in system.normals)
        else 1.0
    )


def rows(system):
    out = [{f"T:{p.name}": 1.0} for p in system.patches] + [{f"w:{p.name}": 1.0} for p in system.patches]
    return out + [{f"N:{k.name}": 1.0} for k in system.normals]


@pytest.mark.parametrize(("kind", "count"), [(TOUCHING, 20), (OPENING, 12), (INERTIA, 12)])
def test_events_do_not_depend_on_the_step(run, kind, count):
    events = 0
    for seed in range(count):
        system = random_system(seed, kind)
        if least_inertia(system) < 0.3:
            continue
        coarse = run(system, COARSE, DURATION, outputs=rows(system))
        fine = run(system, FINE, DURATION)
        assert coarse.what == fine.what, seed
        assert coarse.times == pytest.approx(fine.times, abs=1e-12), seed
        assert coarse.states[-1] == pytest.approx(fine.states[-1], abs=1e-11), seed
        assert abs(coarse.energy["error"]) < 1e-10, seed
        contacts_obey(system, coarse)
        events += len(coarse.times)
    assert events > 100


def contacts_obey(system, found):
    """At every tick: no contact pulls, friction within its cone and against the slip, none where it is open."""
    P = len(system.patches)
    T, w, N = np.split(found.outputs, [P, 2 * P], axis=1)
    keys = [found.motion.mode_sets.sets[s].key for s in found.mode_sets]
    modes = {key: system.modes(key) for key in set(keys)}
    assert np.all(N >= -1e-9)
    for p, patch in enumerate(system.patches):
        stuck = np.array([modes[key][0][p] == STICK and modes[key][1][p] != OPEN for key in keys])
        limit = patch.law.static * N[:, p]
        assert np.all(np.abs(w[stuck, p]) < 1e-12)
        assert np.all(np.abs(T[stuck, p]) <= limit[stuck] * (1.0 + 1e-8) + 1e-9)
        slips = ~stuck & (np.abs(w[:, p]) > 1e-9)
        assert T[slips, p] == pytest.approx(patch.law.numbers[0] * N[slips, p] * np.sign(w[slips, p]), abs=1e-9)
        assert np.all(T[:, p] * w[:, p] >= -1e-12)


@pytest.mark.parametrize(
    ("seed", "event", "modes"),
    [
        (1120, "contact 2 slip ends", "contact 0 slip+, contact 1 stick, contact 2 slip+"),
        (1211, "contact 1 slip ends", "contact 0 stick, contact 1 slip-, contact 2 slip+"),
    ],
)
def test_a_contact_that_turns_round_leaves_the_others_in_stick(run, seed, event, modes):
    """Tried in stick, it would need twenty times what it bears, and tear another contact off on the way.

    That other one, once blamed, sticks again at once: settled one by one without a look at where slip is going, the two
    took turns for ever in one instant.
    """
    system = random_system(seed, INERTIA)
    coarse, fine = run(system, COARSE, DURATION, outputs=rows(system)), run(system, FINE, DURATION)
    assert coarse.what == fine.what
    assert coarse.times == pytest.approx(fine.times, abs=1e-12)
    contacts_obey(system, coarse)
    events = coarse.motion.events()
    afterwards = [system.describe(one.before) for one in events[1:]] + [system.describe(coarse.motion.key)]
    assert (event, modes) in zip(coarse.what, afterwards)


@pytest.mark.parametrize("offset", [0.0, 1e-15, 1e-9])
@pytest.mark.parametrize("step", [0.1, 10.0])
def test_two_oscillators_that_let_go_at_once(run, num, offset, step):
    """An exact tie: both events are found, in order, at the same instant (the offset's own shift)."""
    p = num["P1"]["params"]
    a = Assembly("twins")
    for name, start in (("x", 0.0), ("y", offset)):
        a.coordinate(name, p["m"], p["c"], p["k"])
        a.patch(f"contact {name}", {name: 1.0}, {"one": p["vb"]}, friction_law.coulomb(p["mus"], p["mud"]))
        a.normal(f"load {name}", f"contact {name}", {"one": p["N"]})
        a.start |= {name: start, f"{name}'": p["vb"]}
    found = run(a.system(), step, 4.0)
    x, y = ([t for t, what in zip(found.times, found.what) if f"contact {name} " in what] for name in "xy")
    assert x == pytest.approx(num["P1"]["events"], abs=1e-13)
    assert y == pytest.approx(np.array(num["P1"]["events"]) - offset / p["vb"], abs=1e-13)
    if offset:
        assert found.what[0] == "contact y releases +"
