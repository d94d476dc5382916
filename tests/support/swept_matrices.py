"""Sweeps of matrices that are made up."""

import numpy as np

from rig.analysis.linear.eigenvalue_curves import Spectrum, of_matrix
from rig.analysis.linear.sweep import along
from rig.scenes.axis import Axis


def over(matrix, start=0.0, end=1.0, count=11):
    """The sweep of matrix(p)."""
    values = tuple(np.linspace(start, end, count).tolist())

    def spectra(p):
        A = np.asarray(matrix(p), dtype=float)
        names = tuple(f"s{i}" for i in range(len(A)))
        return Spectrum(*of_matrix(A), names, len(A) // 2, len(A))

    return along("test", Axis("p", "1", values, "1"), spectra)


def turning(growth, frequency):
    """A motion with this growth rate [1/s] and angular frequency [rad/s]."""
    return [[growth, frequency], [-frequency, growth]]


def beside(a, b, coupling=0.0):
    """Two motions in one matrix."""
    A = np.zeros((4, 4))
    A[:2, :2], A[2:, 2:] = a, b
    A[:2, 2:] = A[2:, :2] = turning(0.0, coupling)
    return A
