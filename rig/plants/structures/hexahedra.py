"""Elastic bodies of boxes on one grid, as triquadratic hexahedra, and their vibration modes.

The grid is the product of boundaries along x, y and z; each box is of one material or empty. Boxes share the nodes of
their common faces. An element has 27 nodes with three displacements each and is integrated in full. Frequencies
converge from above with the fourth power of the element size.

The structure is its own mirror image about its middle along x and along y. Each mode is therefore symmetric or
antisymmetric about both. The modes are computed for each of these four classes separately, with a quarter of the
unknowns each. Their symmetry is exact, and two modes of one frequency of a square plate fall into different classes.
Source: textbook elements; assembly by scikit-fem (Gustafsson, McBain, JOSS 5 (2020) 2369).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigsh

from rig.structure.eigenvalues import factor, signed

Array = NDArray[np.float64]

CLASSES = ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
"""Sign of the displacement along z of the mirror image about the middle along x, along y."""
_MIRRORED = np.array([[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])
"""The same of each component: its sign in the mirror image along x, along y is this times that of the class."""
LOST = (
    "the result is lost in rounding, because sizes, stiffness or density of the parts differ too much, "
    "or a Poisson's ratio is too close to 0.5: bring values that lie far apart closer together"
)
_SAME = 1e-9
"""Frequencies that differ by less, relatively, count as equal: their modes are in the order of the classes."""
_ROUNDED = 1e-6  # most that rounding may change the square of a frequency by, relatively
_UNKNOWNS = 16  # least number of unknowns for a mode
_SPARE = 4  # additional modes that are computed for a class beyond its share
_REFINED = 3  # each reduces the error of what modes leave out by shift / (lowest omega left out)^2


@dataclass(frozen=True)
class Material:
    """Linear elastic and isotropic: Young's modulus [Pa], Poisson's ratio, density [kg/m^3]."""

    young: float
    poisson: float
    density: float


@dataclass(frozen=True)
class Part:
    """The boxes of one material: `boxes` [box along x, along y, along z] is true where the material is."""

    material: Material
    boxes: NDArray[np.bool_]


@dataclass(frozen=True)
class Structure:
    """Stiffness [N/m] and mass [kg] matrix; unknown = component * nodes + node, without those of held nodes.

    `axes`: places of the grid's nodes along x, y, z [m], two for each element and one more. `lattice` [node, 3]: the
    number of each node on each of them; x changes fastest, z slowest. `free` [unknown]: whether it is not held. `rigid`
    [unknown, 0 or 6]: translations along and rotations about x, y, z, of mass one, if nothing is held. `shift`
    [rad^2/s^2]: the square of a frequency below those of a bar of this length.
    """

    stiffness: Any
    mass: Any
    axes: tuple[Array, Array, Array]
    lattice: NDArray[np.int64]
    free: NDArray[np.bool_]
    rigid: Array
    shift: float


@dataclass(frozen=True)
class Modes:
    """Vibration modes of mass one in ascending order: `frequencies` [mode] Hz, `vectors` [unknown, mode] kg^-0.5.

    The first six of a free structure are rigid, with a frequency of exactly zero: translations along x, y, z and
    rotations about them.
    """

    frequencies: Array
    vectors: Array


class _Class:
    """The part of a structure with one symmetry: `basis` [unknown, own unknown] has orthonormal columns."""

    def __init__(self, structure: Structure, signs: tuple[float, float]) -> None:
        self.basis = _symmetric(structure, signs)
        self.stiffness = (self.basis.T @ structure.stiffness @ self.basis).tocsc()
        self.mass = (self.basis.T @ structure.mass @ self.basis).tocsc()
        rigid = self.basis.T @ structure.rigid
        self._rigid = rigid[:, np.abs(rigid).max(axis=0) > 0.0]
        self._shift = structure.shift
        self.solve = factor(self.stiffness + structure.shift * self.mass).solve

    def elastic(self, count: int) -> tuple[Array, Array]:
        """Squares of the `count` lowest angular frequencies above zero, ascending; vectors [own unknown, mode]."""

        def inverse(load: Array) -> Array:
            moved = self.solve(load)
            return moved - self._rigid @ (self._rigid.T @ (self.mass @ moved))  # type: ignore[no-any-return]

        size = self.mass.shape[0]
        start = np.random.default_rng(1).standard_normal(size)
        squares, vectors = eigsh(
            self.stiffness,
            k=min(count, size - 1),
            M=self.mass,
            sigma=-self._shift,
            OPinv=LinearOperator((size, size), matvec=inverse, dtype=np.float64),
            v0=inverse(start),
        )
        order = np.argsort(squares)
        return squares[order], vectors[:, order]


def assemble(x: Array, y: Array, z: Array, parts: Sequence[Part], held: bool) -> Structure:
    """The structure of `parts` on the grid with boundaries `x`, `y`, `z` [m]; `held`: the lowest nodes do not move."""
    import skfem  # 0.5 s: only where a model is built

    mesh: Any = skfem.MeshHex.init_tensor(x, y, z)
    middles = mesh.p[:, mesh.t].mean(axis=1)
    boundaries = (x, y, z)
    box = tuple(np.searchsorted(lines, along) - 1 for lines, along in zip(boundaries, middles))
    filled = np.logical_or.reduce([part.boxes for part in parts])[box]
    if not filled.all():
        mesh = mesh.restrict(elements=np.flatnonzero(filled))
        box = tuple(along[filled] for along in box)
    element: Any = skfem.ElementHex2()
    places = skfem.Basis(mesh, element, intorder=4).doflocs.T
    axes = tuple(np.sort(np.concatenate([lines, 0.5 * (lines[1:] + lines[:-1])])) for lines in boundaries)
    lattice = np.stack([_nearest(axis, along) for axis, along in zip(axes, places.T)], axis=1)
    order = np.lexsort(lattice.T)
    places = places[order]
    lattice = lattice[order]

    def assembled(form: Any, basis: Any) -> scipy.sparse.csr_matrix:
        return skfem.BilinearForm(form).assemble(basis)[order][:, order]

    blocks: Any = [[0, 0, 0] for _ in range(3)]
    mass: Any = 0
    for part in parts:
        basis = skfem.Basis(mesh, element, intorder=4, elements=np.flatnonzero(part.boxes[box]))
        products = []
        for i in range(3):
            products.append([assembled(lambda u, v, _, i=i, j=j: v.grad[i] * u.grad[j], basis) for j in range(3)])
        poisson = part.material.poisson
        shear = part.material.young / (2.0 * (1.0 + poisson))
        first = 2.0 * shear * poisson / (1.0 - 2.0 * poisson)
        for i in range(3):
            for j in range(3):
                blocks[i][j] = blocks[i][j] + first * products[i][j] + shear * products[j][i]
            blocks[i][i] = blocks[i][i] + shear * (products[0][0] + products[1][1] + products[2][2])
        mass = mass + part.material.density * assembled(lambda u, v, _: v * u, basis)
    free = np.tile(lattice[:, 2] > 0, 3) if held else np.ones(3 * len(lattice), dtype=np.bool_)
    whole = scipy.sparse.block_diag([mass] * 3, "csr")
    speed = min(part.material.young / part.material.density for part in parts) ** 0.5
    longest = max(lines[-1] - lines[0] for lines in boundaries)
    return Structure(
        stiffness=scipy.sparse.bmat(blocks, format="csr")[free][:, free],
        mass=whole[free][:, free],
        axes=axes,  # type: ignore[arg-type]
        lattice=lattice,
        free=free,
        rigid=np.zeros((int(free.sum()), 0)) if held else _rigid(places, whole),
        shift=(0.1 * speed / longest) ** 2,
    )


def _nearest(axis: Array, places: Array) -> NDArray[np.int64]:
    """The number on an ascending axis that is nearest to each place."""
    return np.searchsorted(0.5 * (axis[1:] + axis[:-1]), places).astype(np.int64)


def _rigid(places: Array, mass: Any) -> Array:
    """Rigid modes [unknown, 6] of mass one. The mirror images make the axes through the centre of mass principal."""
    count = len(places)
    shapes = np.zeros((3 * count, 6))
    for i in range(3):
        shapes[i * count : (i + 1) * count, i] = 1.0
    weights = mass[:count, :count] @ np.ones(count)
    arms = places - (weights @ places) / weights.sum()
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        shapes[j * count : (j + 1) * count, 3 + i] = -arms[:, k]
        shapes[k * count : (k + 1) * count, 3 + i] = arms[:, j]
    return shapes / np.sqrt((shapes * (mass @ shapes)).sum(axis=0))  # type: ignore[no-any-return]


def modes(structure: Structure, count: int) -> Modes:
    """The `count` lowest modes, by Lanczos iteration from a fixed vector.

    The largest entry of each elastic mode is positive; where symmetry makes several equally large, the first of them.
    Raises ValueError for a count that the elements cannot give, or where rounding is larger than the frequencies.
    """
    rigid = structure.rigid.shape[1]
    wanted = count - rigid
    most = structure.stiffness.shape[0] // _UNKNOWNS
    if wanted < 1:
        raise ValueError(f"modes is {count}; a free structure has {rigid} rigid modes: take at least {rigid + 1}")
    if count > most:
        raise ValueError(f"modes is {count}; these elements give at most {most}: take more elements or fewer modes")
    classes = [_Class(structure, signs) for signs in CLASSES]
    asked = [wanted // len(CLASSES) + _SPARE] * len(CLASSES)
    known = [symmetry.elastic(number) for symmetry, number in zip(classes, asked)]
    while True:  # until each class is known up to the highest mode that is taken
        highest = np.sort(np.concatenate([squares for squares, _ in known]))[wanted - 1]
        short = [i for i, (squares, _) in enumerate(known) if squares[-1] <= highest]
        if not short:
            break
        for i in short:
            asked[i] *= 2
            known[i] = classes[i].elastic(asked[i])
    squares = np.concatenate([part for part, _ in known])
    vectors = np.concatenate([symmetry.basis @ part for symmetry, (_, part) in zip(classes, known)], axis=1)
    order = np.argsort(squares, kind="stable")
    steps = np.diff(squares[order], prepend=squares[order[0]])
    level = np.empty(len(squares), dtype=np.int64)
    level[order] = np.cumsum(steps > 2.0 * _SAME * squares[order])
    counts = [len(part) for part, _ in known]
    classes_of = np.repeat(np.arange(len(CLASSES)), counts)
    taken = np.lexsort((classes_of, level))[:wanted]
    squares = squares[taken]
    vectors = signed(vectors[:, taken])
    energies = (vectors * (structure.stiffness @ vectors)).sum(axis=0)
    if not (np.abs(energies - squares) <= _ROUNDED * squares).all():
        raise ValueError(LOST)
    frequencies = np.concatenate([np.zeros(rigid), np.sqrt(squares) / (2.0 * np.pi)])
    return Modes(frequencies, np.concatenate([structure.rigid, vectors], axis=1))


def left_out(structure: Structure, kept: Modes, load: Array) -> Array:
    """Static displacement [unknown] under `load` [unknown] N, without the part that the modes contain.

    `load` is symmetric about both middles. On a free structure it is the elastic displacement under the load and the
    inertia forces that balance it.
    """
    symmetric = _Class(structure, CLASSES[0])
    vectors = symmetric.basis.T @ kept.vectors
    rest = symmetric.basis.T @ load
    rest = rest - symmetric.mass @ (vectors @ (vectors.T @ rest))
    moved = symmetric.solve(rest)
    for _ in range(_REFINED):
        moved = symmetric.solve(rest + structure.shift * (symmetric.mass @ moved))
    return symmetric.basis @ (moved - vectors @ (vectors.T @ (symmetric.mass @ moved)))  # type: ignore[no-any-return]


def compliances(structure: Structure, loads: Array, across: float) -> Array:
    """Work of the static displacements under each load on the others [load, load].

    The structure is held; `loads` [unknown, load] N have the symmetry `across` about the middle across.
    """
    total = np.zeros((loads.shape[1], loads.shape[1]))
    for signs in CLASSES:
        if signs[1] == across:
            basis = _symmetric(structure, signs)
            pushed = np.asarray(basis.T @ loads)
            stiffness = basis.T @ structure.stiffness @ basis
            total += pushed.T @ factor(stiffness).solve(pushed)
    return total


def _symmetric(structure: Structure, signs: tuple[float, float]) -> scipy.sparse.csr_matrix:
    """Orthonormal basis [unknown, own unknown] of the displacements of one class."""
    lattice = structure.lattice
    count = len(lattice)
    last = np.array([len(axis) - 1 for axis in structure.axes])
    number = np.full(last + 1, -1)
    number[tuple(lattice.T)] = np.arange(count)
    low = np.flatnonzero((2 * lattice[:, :2] <= last[:2]).all(axis=1))
    rows = []
    columns = []
    values = []
    for component in range(3):
        sign = _MIRRORED[:, component] * signs
        middle = 2 * lattice[low, :2] == last[:2]
        own = low[~(middle & (sign < 0.0)).any(axis=1)]
        for along in (False, True):
            for across in (False, True):
                image = lattice[own].copy()
                if along:
                    image[:, 0] = last[0] - image[:, 0]
                if across:
                    image[:, 1] = last[1] - image[:, 1]
                value = (sign[0] if along else 1.0) * (sign[1] if across else 1.0)
                rows.append(component * count + number[tuple(image.T)])
                columns.append(component * count + own)
                values.append(np.full(len(own), value))
    where = (np.concatenate(rows), np.concatenate(columns))
    basis = scipy.sparse.coo_matrix((np.concatenate(values), where), shape=(3 * count, 3 * count)).tocsc()
    basis = basis[structure.free]
    lengths = np.sqrt(np.asarray(basis.multiply(basis).sum(axis=0)).ravel())
    kept = np.flatnonzero(lengths)
    return (basis[:, kept] @ scipy.sparse.diags(1.0 / lengths[kept])).tocsr()
