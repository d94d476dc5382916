"""A film of points on any structure: beside exact patches, energy, growth, mirror symmetry, laws over speed.

And how many contacts a rig without a film may have.
"""

from dataclasses import replace

import numpy as np
import pytest
from points_on_structure import structure

from rig.model import assembly, friction_law, mode_sets
from rig.model.assembly import Assembly
from rig.model.method import MANY, chosen
from rig.motion.motion import Motion
from rig.solve.film_steps import OPEN, SLIDES, STICKS

TICK = 100_000  # ns
MASS, DAMPING = np.diag([1.0, 0.7]), np.diag([3.0, 2.0])
STIFFNESS = np.array([[4e4, 9e3], [9e3, 3e4]])
GYROSCOPIC, CIRCULATORY = np.array([[0.0, 40.0], [-40.0, 0.0]]), np.array([[0.0, 5e3], [-5e3, 0.0]])
HEAVY = np.array([[0.0, 0.2], [0.2, 0.0]])
ONE = {"normal": [[0.3, 1.0]], "along": [[1.0, 0.1]], "stiffness": 5e4, "mu": 0.4}


def carried(film, step_ns, duration=0.05, points=ONE, shear=1e9, law=None, matrices=None, **rig):
    """The motion of the two coordinates over the duration, by steps of `step_ns`; as patches by the exact method."""
    rig = {"speed": 5.0, "load": (0.0, 20.0), "start": (0.0, -1e-3)} | rig
    a = structure(*(matrices or (MASS, DAMPING, STIFFNESS)), points | {"shear": shear}, film=film, **rig)
    if law is not None and film:
        a.film = replace(a.film, laws=(law,))
    elif law is not None:
        a.patches = [(name, direction, surface, law, travel) for name, direction, surface, _, travel in a.patches]
    method = "kick" if film else "exact" if law is None else "dopri5"
    ticks = round(duration * 1e9 / TICK)
    substeps = TICK // step_ns if film else 1
    motion = Motion(a.system(), TICK, method, substeps=substeps, longest=ticks, tolerance=1e-10)
    motion.advance(ticks)
    return motion


def difference(one, other):
    """The largest difference of places and speeds, relative to the largest of each."""
    a, b = one.states[:, :4], other.states[:, :4]
    return float((np.abs(a - b).max(axis=0) / np.abs(b).max(axis=0)).max())


@pytest.mark.parametrize(
    "matrices",
    [
        (MASS, DAMPING, STIFFNESS),
        (MASS, DAMPING + GYROSCOPIC, STIFFNESS + CIRCULATORY),
        (MASS + HEAVY, DAMPING + GYROSCOPIC, STIFFNESS + CIRCULATORY),
    ],
)
def test_one_point_that_slips_opens_and_closes_moves_like_an_exact_patch(matrices):
    exact = carried(False, TICK, matrices=matrices)
    assert [event.what for event in exact.events()].count("n1 opens") >= 2
    coarse, fine = (difference(carried(True, step, matrices=matrices), exact) for step in (4000, 1000))
    assert fine < 1e-7
    assert fine < coarse / 8.0


def test_a_stuck_point_creeps_by_its_shear_compliance():
    """It starts at the speed of the surface without friction, sticks, slips and slides on."""
    n, v, load = np.array([0.3, 1.0]), np.array([0.02, 0.0]), np.array([0.0, 20.0])
    start = np.linalg.solve(STIFFNESS + 5e4 * np.outer(n, n), load - DAMPING @ v)
    rig = {"speed": 0.02, "start": start, "velocity": v, "points": ONE | {"along": [[1.0, 0.0]]}}
    exact = carried(False, TICK, **rig)
    assert exact.mode_sets.sets[exact.mode_sets_of_states[0]].key == 2
    assert [event.what for event in exact.events()] == ["c1 releases +"]
    soft, stiff = (difference(carried(True, 200, shear=shear, **rig), exact) for shear in (1e7, 1e8))
    assert stiff == pytest.approx(soft / 10.0, rel=0.2)


@pytest.mark.parametrize("share", [-0.5, 0.5, 2.0, 4.0])
def test_a_slip_that_ends_differs_from_an_exact_patch_as_the_shear_spring_says(share):
    """A mass on a point of constant friction F, pulled by `share` F against its slip: it lands, or slips back.

    Friction passes from F to its new value by the shear of the film, so the speed differs with the root of the
    compliance. Places of a mass that sticks differ in proportion to it.
    """
    m, pressed = 0.8, 20.0 / (3e4 + 5e4)
    F = 0.4 * 5e4 * pressed
    G = share * F
    along = {"matrices": (np.diag([m, 0.7]), np.zeros((2, 2)), np.diag([1.0, 3e4])), "load": (G, 20.0)}
    points = ONE | {"normal": [[0.0, 1.0]], "along": [[1.0, 0.0]]}
    rig = along | {"speed": 0.02, "start": (0.0, pressed), "velocity": (0.019, 0.0), "points": points, "duration": 4e-3}
    exact = carried(False, TICK, **rig)
    assert [event.what for event in exact.events()] == ["c1 slip ends"]
    for shear in (1e7, 1e8):
        off = np.abs(carried(True, 100, shear=shear, **rig).states[:, :4] - exact.states[:, :4])
        root = np.sqrt(m * shear)
        if share < 1.0:  # sticks: T = -G
            assert off[:, 2].max() <= 1.001 * (F + G) / root
            assert off[:, 2].max() > 0.8 * (F + G) / root  # the ring is seen once in a tick
            far = 2.0 * (F + G) if share < 0.0 else 2.0 * F**2 / (F - G)  # it slips at the other end
            assert off[:, 0].max() == pytest.approx(far / shear, rel=1e-2)
        else:
            lag = 2.0 * np.sqrt(F * G) - (G - F) * np.arccos((G - F) / (G + F))
            assert off[-1, 2] == pytest.approx(lag / root, rel=1e-3)


def test_a_law_over_speed_changes_the_friction_as_with_dopri5():
    law = friction_law.stribeck(0.4, 0.25, 0.3)
    rig = {"speed": 1.0, "law": law, "velocity": (0.3, 0.0)}
    truth = carried(False, TICK, **rig)
    coarse, fine = (difference(carried(True, step, **rig), truth) for step in (10_000, 2500))
    assert fine < 1e-5
    assert fine < coarse / 8.0


def disc(
    points=6, modes=10, mirrored=False, coupled=False, mu=0.5, speed=5.0, firm=1e7, highest=3000.0, film=True, **rig
):
    """Modes of a structure with random rows; `mirrored`: a plane of symmetry between its points and coordinates."""
    random = np.random.default_rng(3)
    omega = 2.0 * np.pi * np.linspace(800.0, highest, modes)
    normal, along = random.normal(size=(2, points, modes))
    k, reach = np.full(points, firm) * np.linspace(0.8, 1.2, points), np.linspace(0.08, 0.12, points)
    if mirrored:
        order, half = random.permutation(points), points // 2
        parity = np.where(np.arange(modes) % 3 == 1, -1.0, 1.0)
        for rows in (normal, along):
            rows[order[half:]] = parity * rows[order[:half]]
        k[order[half:]], reach[order[half:]] = k[order[:half]], reach[order[:half]]
    D, K = np.diag(0.004 * omega), np.diag(omega**2)
    if coupled:
        whirl, follow = random.normal(size=(2, modes, modes))
        D, K = D + 50.0 * (whirl - whirl.T), K + 1e5 * (follow - follow.T)
    where = {"normal": normal, "along": along, "stiffness": k, "shear": k, "mu": mu, "reach": reach}
    load = normal.T @ np.full(points, 40.0)
    held = K + (normal.T * k) @ normal - mu * (along.T * k) @ normal
    start = np.linalg.solve(held, load)
    return structure(np.eye(modes), D, K, where, speed, film, load, start, **rig), held, D


@pytest.mark.parametrize("points", [6, 200])
def test_mirror_symmetry_is_found_and_changes_nothing(points):
    a, *_ = disc(points, mirrored=True, firm=6e7 / points)
    film = a.film
    assert film.mirror is not None
    assert sorted(film.mirror.order.tolist()) == list(range(points))
    assert disc(points)[0].film.mirror is None
    each = ("stiffness", "shear", "damping", "mu", "reach", "x", "y")
    more = {name: np.append(getattr(film, name), getattr(film, name)[0]) for name in each}
    plane = np.where(film.mirror.parity > 0.0, 0.5, 0.0)[None, None, :, None] * np.ones((1, 2, 1, 1))
    assert replace(film, rows=np.concatenate([film.rows, plane], axis=3), **more).mirror is None  # a point on the plane
    system = a.system()
    broken = replace(film, rows=film.rows * np.linspace(1.0, 1.0 + 1e-7, points))
    assert broken.mirror is None
    other = replace(system, film=broken)
    motions = [Motion(one, 10_000, "kick", substeps=10, longest=100) for one in (system, other)]
    for motion in motions:
        motion.advance(100)
    used, whole = (motion.mode_sets.tables.film for motion in motions)
    assert used.symmetric.which.size + used.antisymmetric.which.size == 10
    assert used.symmetric.rows.shape[2] < whole.symmetric.rows.shape[2]
    place = [np.abs(motion.states[:, :10]).max() for motion in motions]
    assert place[0] == pytest.approx(place[1], rel=1e-4)


@pytest.mark.parametrize("coupled", [False, True])
def test_small_motions_grow_as_the_eigenvalues_say(coupled):
    a, held, D = disc(coupled=coupled, points=4)
    count = len(held)
    A = np.block([[np.zeros((count, count)), np.eye(count)], [-held, -D]])
    rates, shapes = np.linalg.eig(A)
    fastest = int(np.argmax(rates.real))
    growth, shape = rates[fastest].real, shapes[:, fastest].real
    assert growth > 20.0
    system = a.system()
    begin = system.start.copy()
    begin[: 2 * count] += 2e-3 * np.abs(begin[:count]).max() / np.abs(shape[:count]).max() * shape
    ticks, period = 600, 2.0 * np.pi / abs(rates[fastest].imag)
    motion = Motion(system, 10_000, "kick", substeps=20, longest=ticks)
    for name, value in zip(system.names[: 2 * count], begin):
        motion.write(system.names.index(name), value)
    motion.advance(ticks)
    part = np.linalg.inv(shapes)[fastest]
    size = np.abs((motion.states[:, : 2 * count] - system.start[: 2 * count]) @ part)
    first = round(3.0 * period / 1e-5)
    measured = np.log(size[-1] / size[first]) / ((ticks - 1 - first) * 1e-5)
    assert measured == pytest.approx(growth, rel=1e-3)


@pytest.mark.parametrize("coupled", [False, True])
def test_the_energy_of_points_that_open_and_stick_closes_with_the_square_of_the_step(coupled):
    """In each tenth of a second, relative to the work of friction in it."""
    worst = []
    for substeps in (2, 4):
        a, *_ = disc(coupled=coupled, speed=0.05, velocity=np.full(10, 5e-3), tells=True)
        motion = Motion(a.system(), 10_000, "kick", substeps=substeps, longest=10_000)
        names, shares, before = motion.system.names, [], np.zeros(2)
        for tenth in range(2):
            motion.advance(10_000)
            energy = motion.energy()
            largest = max(abs(value) for name, value in energy.items() if name != "error")
            now = np.array([energy["error"] * largest, energy["friction"]])
            shares.append(abs(np.divide(*(now - before))))
            before = now
            states = motion.states[:, [names.index(f"s:{point}") for point in range(1, 7)]]
            assert set(np.unique(states)) >= ({OPEN, STICKS, SLIDES} if tenth == 0 else {SLIDES})
        worst.append(max(shares))
    assert worst[0] < 1e-3
    assert worst[1] == pytest.approx(worst[0] / 4.0, rel=0.25)


def test_a_mass_that_bounces_on_a_point_keeps_its_energy():
    """Openings are not located. Forces that are held over a step would feed the mass."""
    spring = {"normal": [[-1.0]], "along": [[0.0]], "stiffness": 1e4, "shear": 1e4, "mu": 0.0}
    a = structure([[1.0]], [[0.0]], [[100.0]], spring, 1.0, True, load=[-5.0], start=[0.05])
    ticks = 50_000
    motion = Motion(a.system(), 1_000_000, "kick", longest=ticks)
    motion.advance(ticks)
    z, v = motion.states[:, :2].T
    pressed = motion.states[:, motion.system.names.index("P:1")]
    assert pressed == pytest.approx(np.maximum(-1e4 * z, 0.0), abs=1e-9)
    assert np.count_nonzero((pressed[1:] == 0.0) & (pressed[:-1] > 0.0)) > 100
    total = 0.5 * v * v + 50.0 * z * z + 5.0 * z + 0.5e-4 * pressed**2
    first, last = total[: ticks // 10], total[-ticks // 10 :]
    assert np.abs(total / 0.375 - 1.0).max() < 0.02
    assert last.mean() == pytest.approx(first.mean(), rel=1e-3)


def test_substeps_are_steps():
    system, ends = disc()[0].system(), []
    for substeps in (1, 8):
        motion = Motion(system, 500 * substeps, "kick", substeps=substeps, longest=4000)
        motion.advance(4000 // substeps)
        ends.append(motion.x[:20])
    assert ends[1] == pytest.approx(ends[0], rel=1e-9)


def test_the_film_refuses_what_it_cannot_carry():
    a, *_ = disc()
    a.limit("drive", {"one": 1.0}, -1.0, 1.0, "slid", 1.0)
    assert "no limits" in assembly.refusal(a.system())


def test_mode_sets_that_are_forgotten_are_built_again_with_the_same_bits(monkeypatch):
    """Four patches that open, stick and slip, with room for a few of their mode sets."""
    a, *_ = disc(points=4, film=False, speed=0.05, velocity=np.full(10, 5e-3))
    motions = []
    for bounded in (False, True):
        if bounded:
            monkeypatch.setattr(mode_sets, "TALLIED", 4)
            monkeypatch.setattr(mode_sets, "KEPT", 16)
            monkeypatch.setattr(mode_sets, "MOST_BYTES", 0)
        motion = Motion(a.system(), 10_000, "exact", longest=4)
        for _ in range(500):
            motion.advance(4)
        motions.append(motion)
    free, bounded = motions
    assert len(free.mode_sets.sets) > 30
    assert free.mode_sets.forgotten == 0
    assert len(bounded.mode_sets.sets) <= 16
    assert bounded.mode_sets.forgotten > 10
    assert bounded.x.tobytes() == free.x.tobytes()
    assert bounded.energy() == pytest.approx(free.energy(), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("method", ["auto", "exact", "kick", "dopri5"])
def test_contacts_that_mode_sets_cannot_carry_are_refused_with_the_film_as_remedy(method):
    system = disc(points=24, film=False)[0].system()
    with pytest.raises(ValueError, match=r"mode sets; .*: make the contacts points of a film"):
        Motion(system, 10_000, chosen(method, system))


def test_kick_needs_a_film(rigs):
    with pytest.raises(ValueError, match="method kick supports a film of contact points only"):
        Motion(rigs.p1(), TICK, "kick")


def crowd(count, law):
    """Four modes that are knocked, on contacts that open one by one; the friction of all of them acts on a wall."""
    a, rows = Assembly(title="crowd"), np.random.default_rng(5).normal(size=(count, 4))
    a.patch("pad", {}, {"one": 1.0}, law)
    for i, omega in enumerate(2.0 * np.pi * np.array([300.0, 420.0, 550.0, 700.0])):
        a.coordinate(f"q{i}", 1.0, 0.01 * omega, omega**2)
        a.start[f"q{i}'"] = 0.02
    for point, row in enumerate(rows.tolist()):
        push = {f"q{i}": value for i, value in enumerate(row)}
        a.normal(f"point {point}", "pad", {"one": 1.0} | {q: -2e5 * value for q, value in push.items()}, push)
    return a.system()


def test_twenty_contacts_open_one_by_one_and_twenty_one_are_refused():
    laws = friction_law.coulomb(0.3, 0.3), friction_law.stribeck(0.4, 0.25, 0.3)
    systems, ends = [crowd(20, law) for law in laws], []
    assert systems[0].keys == 3 << 20 <= MANY
    for system, method in zip(systems, ("exact", "dopri5")):
        assert chosen("auto", system) == method
        motion = Motion(system, TICK, method, longest=50, tolerance=1e-9, cap=1000)
        motion.advance(50)
        opened = [event for event in motion.events() if event.what.endswith(" opens")]
        assert len(opened) > 30
        assert len({event.what for event in opened}) > 10
        assert len(motion.mode_sets.sets) > 40
        assert abs(motion.energy()["error"]) < 1e-6
        ends.append(motion.x[:8])
    assert ends[1] == pytest.approx(ends[0], rel=1e-6)
    with pytest.raises(ValueError, match=r"^21 contacts .* 6.3e\+06 mode sets; .* 4.2e\+06: make the contacts points"):
        Motion(crowd(21, laws[0]), TICK, "exact")
