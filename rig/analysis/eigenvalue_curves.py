"""The eigenvalues of a scene followed along a parameter, with a measure of how reliable the pairing is.

Two spectra are paired by the modal assurance criterion (MAC) of their left and right eigenvectors and by the distance
of the eigenvalues:

    MAC_ij = |(l_i r'_j)(l'_j r_i)| / |(l_i r_i)(l'_j r'_j)|      one for the same mode, whatever the units
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.modes import Slow, at_rest, missing, under_dither
from rig.design.linearised import energy_form
from rig.errors import Singular
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
SURE = 0.7  # MAC of a pair that needs no smaller step
NOTHING, OPENS, JAMS = "no steady sliding", "the contact would open", "jams"
SLOW = "the dither is not fast"
DEPTH = 8  # most halvings of a step between two values whose pairs are not certain


class Spectrum(NamedTuple):
    """Eigenvalues `rates` [i], least stable first, right and left vectors [state, i], names of the states.

    The first `own` states belong to the rig, and the first of these are its `coordinates`. `exists`: whether steady
    sliding exists there; `counts`: whether the eigenvalues are valid; `note`: what makes them invalid, with the reason
    `why` in words. `inertia`: determinant of the mass matrix with friction over that without; below zero the rig jams.
    `energy`: rig.design.linearised.energy_form over the first states; empty if it is not known.
    """

    rates: Complex
    right: Complex
    left: Complex
    names: tuple[str, ...]
    coordinates: int
    own: int
    exists: bool = True
    counts: bool = True
    note: str = ""
    inertia: float = 1.0
    why: str = ""
    energy: Array = np.zeros((0, 0))


Spectra = Callable[[float], Spectrum]


def of_matrix(A: Array) -> tuple[Complex, Complex, Complex]:
    """Return eigenvalues, least stable first, right and left vectors [state, i] of A."""
    from scipy.linalg import eig

    values, left, right = eig(A, left=True, right=True)
    order = np.lexsort((-values.imag, -values.real))
    return values[order], right[:, order], left[:, order].conj()


def sliding(at: Steady) -> Spectrum:
    """Return the spectrum of steady sliding."""
    rates, right, left = of_matrix(at.A[np.ix_(at.moving, at.moving)])
    note = JAMS if at.inertia <= 0.0 else "" if at.exists else OPENS if at.counts and not at.beyond else NOTHING
    names, nq = tuple(at.system.names[i] for i in at.moving), len(at.system.coordinates)
    why = "" if at.exists else missing(at)
    energy = energy_form(at)[np.ix_(at.moving, at.moving)]
    return Spectrum(rates, right, left, names, nq, len(names), at.exists, at.counts, note, at.inertia, why, energy)


def pairs(a: Spectrum, b: Spectrum) -> tuple[NDArray[np.int64], bool]:
    """Return for each rate of `a` the index of its continuation in `b` (-1: none), and whether all pairs are
    certain.
    """
    from scipy.optimize import linear_sum_assignment

    if a.names == b.names:
        across, back = a.left.T @ b.right, b.left.T @ a.right
        own = np.abs(np.sum(a.left * a.right, axis=0))[:, None] * np.abs(np.sum(b.left * b.right, axis=0))[None, :]
        mac = np.minimum(np.abs(across * back.T) / np.maximum(own, 1e-300), 1.0)
    else:
        mac = np.ones((len(a.rates), len(b.rates)))
    far = np.abs(a.rates[:, None] - b.rates[None, :])
    size = max(float(np.abs(a.rates).max(initial=0.0)), float(np.abs(b.rates).max(initial=0.0)), 1e-300)
    rows, columns = linear_sum_assignment(1.0 - mac + far / size)
    found = np.full(len(a.rates), -1, dtype=np.int64)
    found[rows] = columns
    return found, bool(np.all(mac[rows, columns] > SURE)) and len(a.rates) == len(b.rates)


def follow(spectra: Spectra, x: float, a: Spectrum, y: float, b: Spectrum, depth: int = DEPTH) -> NDArray[np.int64]:
    """Return the `pairs` of spectrum a at x and spectrum b at y, with as many values between as certainty needs."""
    found, sure = pairs(a, b)
    if sure or depth == 0:
        return found
    middle = 0.5 * (x + y)
    half = spectra(middle)
    if not half.counts or len(half.rates) != len(a.rates):
        return found
    first = follow(spectra, x, a, middle, half, depth - 1)
    second = follow(spectra, middle, half, y, b, depth - 1)
    return np.where(first >= 0, second[first], -1)


def equilibrium(scene: Scene, dithered: bool = False) -> Spectrum:
    """Return the spectrum of a scene at its sliding equilibrium, without controllers.

    `dithered`: with the friction averaged over its dither, else with dither off.
    """
    try:
        return sliding(under_dither(scene) if dithered else at_rest(scene)[1])
    except Slow as error:
        return absent(SLOW, str(error))
    except Singular as error:
        return absent(JAMS, "friction takes up all of the inertia", 0.0) if error.jams else absent(NOTHING, error.why)


def absent(note: str, why: str, inertia: float = 1.0) -> Spectrum:
    """Return the empty spectrum of a place without steady sliding."""
    none = np.zeros((0, 0), dtype=np.complex128)
    return Spectrum(none.diagonal(), none, none, (), 0, 0, False, False, note, inertia, why)
