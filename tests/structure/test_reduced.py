"""Reduced structures against their full matrices."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from disc_with_pads import disc, paired

from rig.errors import UsageError
from rig.structure import eigenvalues
from rig.structure.basis import Reduction, build
from rig.structure.estimate import Estimator, growing_without_friction, weaker_modes
from rig.structure.full import FRICTION, Full, Part, Points
from rig.structure.reduced import Reduced

STIFFNESS, AREA = 1e8, 1e-4


def structure(sides: int = 6, held: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Full:
    """A lattice of masses on springs that is held at one end, with four contact points between it and a small block.

    Its section is square: bending modes come in pairs. `held`: how far springs guide the block along x, y, z.
    """
    length, small = 12, 3

    def chain(number: int, end: float) -> sp.csr_array:
        line = sp.diags_array([-np.ones(number - 1), np.full(number, 2.0), -np.ones(number - 1)], offsets=[-1, 0, 1])
        free = line.tolil()
        free[number - 1, number - 1] = 1.0
        free[0, 0] = 1.0 + end
        return sp.csr_array(free)

    def lattice(along: int, end: float) -> sp.csr_array:
        one, cross = sp.eye_array(along), sp.eye_array(sides)
        total = sp.kron(sp.kron(chain(along, end), cross), cross)
        total = total + sp.kron(sp.kron(one, chain(sides, 0.0)), cross)
        total = total + sp.kron(sp.kron(one, cross), chain(sides, 0.0))
        coupled = np.array([[1.0, 0.1, 0.1], [0.1, 0.6, 0.1], [0.1, 0.1, 0.6]])
        return sp.csr_array(sp.kron(total, 1e6 * coupled))

    guide = sp.kron(sp.eye_array(small * sides**2), 1e3 * np.diag(held))
    stiffness = sp.csr_array(sp.block_diag([lattice(length, 1.0), lattice(small, 0.0) + guide]))
    rows = stiffness.shape[0]
    disc = 3 * length * sides**2
    normal, along = np.zeros((4, rows)), np.zeros((4, rows))
    for point in range(4):
        below = 3 * ((4 + 2 * (point // 2)) * sides**2 + (point % 2) * (sides - 1) * sides + sides - 1)
        above = disc + 3 * ((2 * (point // 2)) * sides**2 + (point % 2) * (sides - 1) * sides)
        normal[point, [above + 2, below + 2]] = 1.0, -1.0
        along[point, [above, below]] = 1.0, -1.0
    contact = Points(
        "pad",
        sp.csr_array(normal),
        sp.csr_array(along),
        np.full(4, AREA),
        np.ones(4),
        np.zeros((4, 3)),
        np.eye(4)[:, :3],
    )
    load = np.zeros(rows)
    load[-1] = -1.0
    parts = (
        Part("M", "mass", sp.csr_array(sp.eye_array(rows) * 1e-3)),
        Part("D", "damping", stiffness, factor=2e-7),
        Part("K", "stiffness", stiffness),
    )
    number = np.arange(rows)
    return Full(parts, number // 3, number % 3, contacts=(contact,), vectors={"load": load})


def values(mu: float = 0.0, stiffness: float = STIFFNESS * 1e4) -> dict[str, float]:
    """The numbers of the scene."""
    return {FRICTION: mu, "contacts.pad.stiffness": stiffness}


def compared(reduced: Reduced, full: Full, given: dict[str, float], up_to: float) -> tuple[float, int]:
    """The largest relative error of an eigenvalue up to `up_to` [rad/s], and how many the full matrices do not have."""
    exact = eigenvalues.complex_eigenvalues(*full.pencil(given), up_to).values
    near = reduced.eigenvalues(given)[0]
    errors = [np.min(np.abs(near - value)) / abs(value) for value in exact]
    inside = (near.imag > 1.0) & (near.imag < up_to * (1 - 1e-6)) & (abs(near.real) < 0.49 * near.imag)
    return max(errors), int(np.sum(inside)) - int(np.sum(exact.imag < up_to * (1 - 1e-6)))


@pytest.mark.parametrize("stiffness", [1e11, 1e12, 1e13])
def test_closed_modes_and_attachments_give_the_eigenvalues_of_the_full_matrices_at_any_stiffness(stiffness):
    full = structure()
    reduced = build(full, Reduction(modes=60, at=values()))
    error, more = compared(reduced, full, values(0.5, stiffness), 8000.0)
    assert error < 1e-6
    assert more == 0


def test_modes_without_the_flexibility_near_the_contacts_do_not_converge_and_springs_in_series_repair_it():
    full = structure()
    exact = eigenvalues.complex_eigenvalues(*full.pencil(values()), 8000.0).values
    errors = {}
    for residual in ("omitted", "spring", "attachment"):
        reduced = build(full, Reduction(modes=60, contact="open", residual=residual, at=values()))
        near = reduced.eigenvalues(values())[0]
        errors[residual] = max(np.min(np.abs(near - value)) / abs(value) for value in exact)
    assert errors["omitted"] > 10 * errors["spring"] > 100 * errors["attachment"]


def test_a_pair_of_equal_modes_is_not_cut():
    full = structure(4)
    mass, stiffness = full.matrix("mass", {}), full.matrix("stiffness", {})
    exact = np.linalg.eigvalsh(stiffness.toarray() / 1e-3)
    for count in range(1, 25):
        square = eigenvalues.modes(stiffness, mass, count).square
        assert count <= square.size < count + 5
        assert np.allclose(square, exact[: square.size], rtol=1e-9)
        assert exact[square.size] > (1 + eigenvalues.GAP) * square[-1]


def test_all_complex_eigenvalues_of_two_equal_structures_come_twice():
    full = replace(structure(4), contacts=())
    pencil = full.pencil({})
    single = eigenvalues.complex_eigenvalues(*pencil, 9000.0).values
    double = eigenvalues.complex_eigenvalues(*(sp.csr_array(sp.block_diag([m, m])) for m in pencil), 9000.0).values
    assert np.allclose(double, np.repeat(single, 2), rtol=1e-9)


def test_where_every_mode_is_in_the_range_the_basis_is_the_whole_structure():
    full = structure(3)
    near = build(full, Reduction(up_to=1e7, at=values())).eigenvalues(values(0.4))[0]
    exact = eigenvalues.dense(*(matrix.toarray() for matrix in full.pencil(values(0.4))), "none")[0]
    assert near.size == exact.size == 2 * full.rows
    assert max(np.min(np.abs(exact - value)) / abs(value) for value in near) < 1e-9


def test_the_flexibility_left_out_is_that_of_the_modes_left_out_beside_a_rigid_mode_too():
    full = structure(2, held=(1.0, 1.0, 0.0))
    reduced = build(full, Reduction(modes=12, contact="open", residual="spring", at=values()))
    assert reduced.rigid == 1
    square, shapes = np.linalg.eigh(full.matrix("stiffness", {}).toarray() / 1e-3)
    left_out = full.contacts[0].normal @ shapes[:, reduced.coordinates :] / np.sqrt(1e-3)
    exact = np.sum(left_out**2 / square[reduced.coordinates :], axis=1)
    assert np.allclose(reduced.model.contacts[0].flexibility, exact, rtol=1e-6)


def test_a_block_that_only_the_contact_holds_is_refused_where_it_stays_loose():
    loose = structure(held=(0.0, 0.0, 0.0))
    with pytest.raises(UsageError, match="leaves 2 rigid modes that no contact and no support holds"):
        build(loose, Reduction(modes=20, at=values()))


def test_matrices_of_few_rows_stay_as_they_are():
    full = structure(2)
    reduced = build(full, Reduction("whole"))
    exact = eigenvalues.dense(*(matrix.toarray() for matrix in full.pencil(values(0.3))))[0]
    for vectors in ("none", "right", "both"):
        near = reduced.eigenvalues(values(0.3), vectors=vectors)[0]
        assert np.allclose(np.sort_complex(near), np.sort_complex(exact))
    with pytest.raises(UsageError, match="have 1620 rows; at most 300"):
        build(structure(), Reduction("whole"))


def test_the_estimated_error_is_the_true_one_with_modal_damping_too():
    full = structure(2)
    reduced = build(full, Reduction(modes=6, at=values(), residual="omitted", up_to=6000.0))
    damping = np.diag(np.linspace(2.0, 20.0, reduced.coordinates))
    basis = reduced.basis.astype(float)
    modal = full.parts[0].matrix @ basis
    mass, own, stiffness = full.pencil(values(0.4))
    exact = eigenvalues.dense(mass.toarray(), own.toarray() + modal @ damping @ modal.T, stiffness.toarray())[0]
    estimates = Estimator(full, reduced.up_to, values()).at(reduced, values(0.4), damping)
    assert estimates.values.size == 5  # up to 6000 rad/s
    true = exact[np.argmin(np.abs(exact - estimates.values[:, None]), axis=1)] - estimates.values
    told = np.abs(true) > 1e-8 * np.abs(estimates.values)
    assert np.sum(told) >= 3
    assert np.all((np.abs(true - estimates.errors) < 0.5 * np.abs(true))[told])


@pytest.mark.parametrize("beside", ["stack", "falling friction", "both"])
def test_the_estimated_error_is_the_true_one_beside_a_stack_with_its_network_and_friction_over_speed(beside):
    """Truth: the full matrices with the same forces and the same network."""
    end = np.zeros(180)
    end[[80, 170]] = 1.0, -1.0
    full = structure(2)
    full = replace(full, vectors={**full.vectors, "piezo.first": end})
    reduced = build(replace(full, vectors={}), Reduction(modes=10, at=values(), residual="omitted", up_to=6000.0))
    given, slopes = values(0.4), 0.3 * np.array([1.0, 1.2, 0.8, 1.1]) * ("stack" != beside)
    spring, coupling, capacitance, inductance, ohms = 3e5 * (beside != "falling friction"), 0.3, 1e-6, 0.05, 100.0

    def rig_of(pencil, along, end):
        mass, damping, stiffness = (np.asarray(m.toarray() if sp.issparse(m) else m) for m in pencil)
        n = len(mass)
        jacobian = np.zeros((2 * n + 2, 2 * n + 2))  # voltage of the stack, current through a coil and a resistor
        jacobian[:n, n : 2 * n] = np.eye(n)
        rows = np.linalg.inv(mass)
        jacobian[n : 2 * n, :n] = -rows @ (stiffness + spring * np.outer(end, end))
        jacobian[n : 2 * n, n : 2 * n] = -rows @ (damping - along.T @ (slopes[:, None] * along))
        jacobian[n : 2 * n, 2 * n] = -coupling * bool(spring) * rows @ end
        jacobian[2 * n, n : 2 * n] = coupling / capacitance * end
        jacobian[2 * n, 2 * n + 1] = -1.0 / capacitance
        jacobian[2 * n + 1, 2 * n :] = 1.0 / inductance, -ohms / inductance
        return jacobian

    basis = reduced.basis.astype(float)
    reduced = replace(reduced, model=replace(reduced.model, vectors={"piezo.first": end @ basis}))
    exact = np.linalg.eigvals(rig_of(full.pencil(given), full.contacts[0].along.toarray(), end))
    own = rig_of(reduced.pencil(given), reduced.model.contacts[0].along, end @ basis)
    estimates = Estimator(full, reduced.up_to, values()).at(reduced, given, jacobian=own)
    true = exact[np.argmin(np.abs(exact - estimates.values[:, None]), axis=1)] - estimates.values
    told = np.abs(true) > 1e-8 * np.abs(estimates.values)
    assert np.sum(told) >= 4
    assert np.all((np.abs(true - estimates.errors) < 0.2 * np.abs(true))[told])


def test_a_basis_is_trained_where_its_error_is_largest_until_it_is_small():
    full = structure(4)
    foundation = np.random.default_rng(1).uniform(0.0, 2e5, full.rows)
    full = replace(
        full,
        parts=(*full.parts, Part("foundation", "stiffness", sp.csr_array(sp.diags_array(foundation)), "factor", 2)),
    )
    told = []
    over = {FRICTION: (0.0, 0.8), "factor": (0.0, 1.5)}
    reduction = Reduction("snapshots", up_to=14000.0, at=values(), over=over, vectors=100, error=3e-7)
    reduced = build(full, reduction, lambda what, share: told.append((what, share)))
    assert reduced.error <= 3e-7
    assert len(reduced.points) > 1
    assert told[-1][1] == 1.0
    for mu, factor in ((0.17, 0.2), (0.66, 1.37), (0.41, 0.9)):
        error, more = compared(reduced, full, values(mu) | {"factor": factor}, 14000.0)
        assert error < 3e-7
        assert more == 0
    assert reduced.outside(values(0.9, 1e9) | {"factor": -1.0}) == [
        "factor = -1 lies outside of the range that the basis was trained for, 0 to 1.5",
        "contacts.pad.stiffness = 1e+09 lies outside of the range that the basis was trained for, 1e+12 to 1e+12",
        "friction.mu = 0.9 lies outside of the range that the basis was trained for, 0 to 0.8",
    ]
    assert Reduced.from_bytes(reduced.to_bytes()).to_bytes() == reduced.to_bytes()


def test_ranges_that_cannot_be_trained_are_refused_all_at_once():
    full = structure(2)
    full = replace(full, parts=(*full.parts, replace(full.parts[1], name="D1", key="drive.speed", power=-1)))
    over = {"factors.f": (1.0, 2.0), FRICTION: (0.5, 0.1), "drive.speed": (0.0, 3.0)}
    with pytest.raises(UsageError) as refused:
        build(full, Reduction("snapshots", over=over))
    assert str(refused.value).splitlines() == [
        "reduction.over: factors.f multiplies nothing of this structure; "
        "it has drive.speed, contacts.pad.stiffness, friction.mu",
        "reduction.over: friction.mu is trained from 0.5 to 0.1; the second number must be larger",
        "reduction.over: D1 is divided by drive.speed, whose range from 0 to 3 contains zero",
        "contacts.pad.stiffness has no value",
    ]


def test_springs_in_series_beside_closed_contacts_are_refused():
    with pytest.raises(UsageError, match="use contact = 'open', or residual = 'attachment'"):
        build(structure(2), Reduction(modes=10, residual="spring", at=values()))


def test_thousands_of_modes_are_counted_and_refused_at_once():
    full = structure()
    with pytest.raises(eigenvalues.Incomplete, match=rf"{full.rows} modes lie below .* at most 600 are computed"):
        build(full, Reduction(up_to=1e9, at={full.contacts[0].stiffness_key: STIFFNESS}))


def test_a_row_without_stiffness_and_mass_is_named():
    full = structure(2)
    empty = sp.csr_array((1, 1))
    parts = tuple(replace(part, matrix=sp.csr_array(sp.block_diag([part.matrix, empty]))) for part in full.parts)
    with pytest.raises(eigenvalues.Incomplete, match="a row has neither stiffness nor mass"):
        build(Full(parts, np.arange(181), np.arange(181)), Reduction(modes=10))


@pytest.mark.parametrize(("alone", "motions"), [(False, "180 motions"), (True, "1 motion")])
def test_negative_stiffness_is_named(alone, motions):
    """Of all rows, or of the first row alone."""
    full = structure(2)
    stiffness = full.matrix("stiffness", {})
    first = sp.csr_array(([-10.0 * stiffness.diagonal().max()], ([0], [0])), shape=stiffness.shape)
    wrong = Part("wrong", "stiffness", first if alone else -2.0 * stiffness)
    with pytest.raises(eigenvalues.Incomplete, match=f"the stiffness is negative for {motions}: check its sign"):
        build(Full((*full.parts, wrong), full.node, full.direction), Reduction(modes=10))


def test_negative_damping_is_named_with_its_growth():
    full = structure(2)
    reduced = build(full, Reduction("whole"))
    assert not growing_without_friction(reduced, values(0.5))
    wrong = replace(full, parts=(*full.parts, Part("wrong", "damping", sp.csr_array(-1.0 * full.parts[0].matrix))))
    sentences = growing_without_friction(build(wrong, Reduction("whole")), values(0.5))
    assert sentences[0].endswith("the damping is negative; check the sign and the unit of each damping part")


PADS = ("contacts.pad_up.stiffness", "contacts.pad_down.stiffness")


def squealing(points: tuple[int, int] | None, finer: tuple[int, int] | None = None) -> Full:
    """The disc with two pads, so many contact points on each, and damping in proportion to the stiffness."""
    full = disc()[0]
    stiffness = next(part for part in full.parts if part.of == "stiffness")
    damping = replace(stiffness, name="D", of="damping", factor=2 * 0.002 / (2 * np.pi * 3000.0))
    contacts = tuple(paired(points)), tuple(paired(finer)) if finer else ()
    return replace(full, parts=(*full.parts, damping), contacts=contacts[0], finer=contacts[1])


def pressed(mu: float) -> dict[str, float]:
    """The numbers of the scene of the disc."""
    return {FRICTION: mu, **dict.fromkeys(PADS, 1e11)}


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.3, 0.6])
def test_forty_closed_modes_and_attachments_give_the_squeal_of_the_disc(mu):
    full = squealing((3, 4))
    reduced = build(full, Reduction(modes=40, at=pressed(0.0)))
    exact = eigenvalues.complex_eigenvalues(*full.pencil(pressed(mu)), 2 * np.pi * 6500.0).values
    up_to = 2 * np.pi * 6500.0
    soft = {**pressed(0.3), **dict.fromkeys(PADS, 1e9)}
    estimates = Estimator(full, up_to, soft).at(replace(reduced, up_to=up_to), pressed(mu))
    true = np.abs(exact - estimates.values) / np.abs(exact)
    below = exact.imag < 2 * np.pi * 4000.0
    growing = exact.real > 0
    growth = np.abs(exact.real - estimates.values.real)[growing] / exact.real[growing]
    assert true.max() < (1e-5 if mu < 0.5 else 1e-4)
    assert true[below].max() < 1e-6
    assert growth.max() < (1e-4 if mu < 0.5 else 1e-2)
    told = true > 1e-8
    assert np.allclose(estimates.relative[told], true[told], rtol=0.5)


@pytest.mark.slow
def test_a_mode_that_few_contact_points_miss_is_named():
    squeal = {}
    for points, finer in (((3, 4), (4, 6)), ((4, 6), None), (None, None)):
        reduced = build(squealing(points, finer), Reduction(modes=40, at=pressed(0.0)))
        found = reduced.eigenvalues(pressed(0.6))[0]
        below = found[(found.imag > 0) & (found.imag < 2 * np.pi * 3000.0) & (found.real > 0)]
        squeal[points] = below[np.argsort(below.imag)]
        if finer:
            mass, damping, stiffness = reduced.pencil(pressed(0.6))
            forces = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
            sentences = weaker_modes(reduced, pressed(0.6), np.vstack([np.eye(*forces.shape, k=len(mass)), forces]))
            missed = [sentence for sentence in sentences if "may miss a weaker unstable mode" in sentence]
            assert len(missed) == 1
            assert "24 contact points" in missed[0]
            assert "with 48 points the mode at 2372 Hz grows" in missed[0]
            assert missed[0].endswith("set more contacts.NAME.points")
    assert squeal[3, 4].size == 1
    few, all_points = squeal[4, 6], squeal[None]
    assert few.size == all_points.size == 2
    assert np.allclose(few.imag, all_points.imag, rtol=0.02)
    assert few[0].real == pytest.approx(all_points[0].real, rel=0.07)
