"""The lowest vibration modes of a flexible annular disc, clamped at its inner and free at its outer edge.

    R(r) = A J_l(k r) + B Y_l(k r) + C I_l(k r) + E K_l(k r),   omega = k^2 (D / rho h)^0.5,  D = E h^3 / 12 (1 - nu^2)
    r = a:  R = 0,  R' = 0
    r = b:  R'' + nu (R' / r - l^2 R / r^2) = 0
            d/dr (lap R) - (1 - nu) l^2 / r^2 (R' - R / r) = 0           (Kelvin and Kirchhoff's edge force)

Normalised to rho h int psi^2 dA = 1, psi = R cos(l theta) and, for l > 0, R sin(l theta) as well.
Source: Kirchhoff's plate; Liu and Ouyang, Meccanica 55 (2020), section 3.

Terms of a contact that depend on its position on the disc are tables of their own, `Geometry` and `Slope`. Friction and
normal force act at the angle phi = s / r0 of the slider. Without `Geometry` they act at phi = 0, and only the friction
law is nonlinear. `Slope` is the component of the normal force along the inclined surface, -N dw / (r0 dtheta) on the
slider; the paper assumes a vertical normal force. Without `Slope` the energy balance of the rig is not closed: the
moving load does work on the disc that no other term supplies.
Source: Liu and Ouyang, Meccanica 55 (2020), equations 19, 29, 30 (geometry); slope derived.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray
from pydantic import model_validator

from rig.about import About
from rig.quantities import KilogramPerCubicMetre, Pascal, PoissonRatio, PositiveMetre, Ratio, Section

Array = NDArray[np.float64]
Count = Annotated[int, Ge(1), Le(200)]
_PER_WAVE = 16  # points in the shortest distance of two roots
_HALVINGS = 60  # of an interval with a root: more than a double has bits
_SLOWEST = 0.9  # k b / l: the slowest wave is the one along the free edge, with 0.98 for nu = 0.5
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


class Disc(Section):
    """The disc: dimensions, material, `damping_ratio` of each mode in the frame of the material, number of modes."""

    declares: ClassVar = About("the disc bends, instead of moving along its axis and tilting as a rigid body")

    inner_radius: PositiveMetre
    outer_radius: PositiveMetre
    thickness: PositiveMetre
    density: KilogramPerCubicMetre
    modulus: Pascal
    poisson: PoissonRatio
    damping_ratio: Ratio = 0.0
    modes: Count = 7

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.inner_radius >= self.outer_radius:
            raise ValueError(f"inner_radius {self.inner_radius:g} m is not below outer_radius {self.outer_radius:g} m")
        count = sum(mode.pair + 1 for mode in free_modes(self))
        if count != self.modes:
            raise ValueError(
                f"modes {self.modes} would take one mode of a pair (cosine and sine); give {count - 2} or {count}"
            )
        return self

    def off(self, radius: float) -> str:
        """Why no point of the free part of the disc is at this radius [m]; "" if there is one."""
        low = self.inner_radius
        high = self.outer_radius
        if low < radius <= high:
            return ""
        where = "inside of the clamp" if radius <= low else "outside of the disc"
        return f"is {where}: more than inner_radius {low:g} m, at most outer_radius {high:g} m"

    @property
    def rigidity(self) -> float:
        """Bending stiffness D [N m]."""
        return float(self.modulus * self.thickness**3 / (12.0 * (1.0 - self.poisson**2)))

    @property
    def areal(self) -> float:
        """Mass per area [kg/m^2]."""
        return float(self.density * self.thickness)


@dataclass(frozen=True)
class Mode:
    """A mode with `circles` nodal circles and `diameters` nodal diameters l; where l > 0, a pair of equal frequency.

    `omega` [rad/s], `wavenumber` k [1/m], `coefficients` (A, B, C, E) of J, Y, I exp(-k b), K exp(k a) [kg^-0.5].
    """

    circles: int
    diameters: int
    omega: float
    wavenumber: float
    coefficients: tuple[float, float, float, float]
    disc: Disc

    @property
    def pair(self) -> bool:
        """Whether there is a sine beside the cosine."""
        return self.diameters > 0

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its coordinates: cosine and, for a pair, sine."""
        which = f"{self.diameters}.{self.circles}" if self.circles else f"{self.diameters}"
        return (f"C{which}", f"S{which}") if self.pair else (f"C{which}",)

    def at(self, radius: float) -> float:
        """The shape R at a radius [m], in kg^-0.5; positive at the outer edge."""
        return _at(self, radius)


class Geometry(Section):
    """The contact moves round the disc with the slider. The table has no parameters."""

    declares: ClassVar = About(
        "friction and normal force act at the place of the slider; without it at its initial place"
    )


class Slope(Section):
    """The normal force has a component along the inclined surface. The table has no parameters."""

    declares: ClassVar = About("the normal force pushes along the inclined surface")


@cache
def free_modes(disc: Disc) -> tuple[Mode, ...]:
    """The lowest `disc.modes` modes of the disc at rest, in order of frequency; a pair counts as two.

    One more mode if the last one would otherwise be half of a pair.
    """
    most = 2.0 / (disc.outer_radius - disc.inner_radius)
    while True:
        roots = []
        for l in range(math.ceil(disc.outer_radius * most / _SLOWEST) + 1):
            roots += [(float(k), l, circles) for circles, k in enumerate(_roots(disc, l, most))]
        roots.sort()
        counted = np.cumsum([2 if l else 1 for _, l, _ in roots])
        if len(roots) and counted[-1] >= disc.modes:
            break
        most *= 1.5
    last = int(np.searchsorted(counted, disc.modes))
    return tuple(_mode(disc, l, circles, k) for k, l, circles in roots[: last + 1])


def _roots(disc: Disc, l: int, most: float) -> Array:
    """Wavenumbers [1/m] up to `most` that satisfy the edge conditions, rising: roots of the determinant, bisected."""
    step = math.pi / (disc.outer_radius - disc.inner_radius) / _PER_WAVE
    k = np.arange(max(0.25 * step, _SLOWEST * l / disc.outer_radius), most + step, step)
    value = _determinant(disc, l, k)
    below = np.flatnonzero(value[:-1] * value[1:] < 0.0)
    low = k[below]
    high = k[below + 1]
    sign = np.sign(value[below])
    for _ in range(_HALVINGS if len(below) else 0):
        middle = 0.5 * (low + high)
        same = np.sign(_determinant(disc, l, middle)) == sign
        low = np.where(same, middle, low)
        high = np.where(same, high, middle)
    roots = 0.5 * (low + high)
    return roots[roots <= most]


def _determinant(disc: Disc, l: int, k: Array) -> Array:
    return np.asarray(np.linalg.det(_scaled(disc, l, k)[0]))


def _scaled(disc: Disc, l: int, k: Array) -> tuple[Array, Array]:
    """Edge conditions [k, condition, function] with columns of norm one, and the norms of the columns [k, function]."""
    a = disc.inner_radius
    b = disc.outer_radius
    nu = disc.poisson
    f, g = _functions(disc, l, k, a)
    inner = [f, g]
    f, g = _functions(disc, l, k, b)
    x = (k * b)[:, None]
    bend = np.array([-1.0, -1.0, 1.0, 1.0])  # lap f = bend k^2 f
    second = -g / x + (bend + (l / x) ** 2) * f
    moment = second + nu * (g / x - (l / x) ** 2 * f)
    shear = bend * g - (1.0 - nu) * (l / x) ** 2 * (g - f / x)
    rows = np.stack([*inner, moment, shear], axis=1)
    size = np.abs(rows).max(axis=1)
    return rows / size[:, None, :], size


def _functions(disc: Disc, l: int, k: Array, r: float | Array) -> tuple[Array, Array]:
    """J, Y, I exp(-k b), K exp(k a) at k r [k, function], and their derivatives with respect to k r."""
    from scipy import special

    x = k * r
    grow = np.exp(k * (r - disc.outer_radius))
    fall = np.exp(-k * (r - disc.inner_radius))
    scale: list[Any] = [1.0, 1.0, grow, fall]
    four = (special.jv, special.yv, special.ive, special.kve)
    f = [s * function(l, x) for s, function in zip(scale, four)]
    before = [s * function(l - 1, x) for s, function in zip(scale, four)]
    after = [s * function(l + 1, x) for s, function in zip(scale, four)]
    sides = ((1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, -1.0))
    g = [0.5 * (p * below + q * above) for (p, q), below, above in zip(sides, before, after)]
    return np.stack(f, axis=-1), np.stack(g, axis=-1)


def _mode(disc: Disc, l: int, circles: int, k: float) -> Mode:
    rows, size = _scaled(disc, l, np.array([k]))
    coefficients = np.linalg.svd(rows[0])[2][-1] / size[0]
    omega = k**2 * math.sqrt(disc.rigidity / disc.areal)

    def scaled(factor: float) -> Mode:
        first, second, third, fourth = (float(factor * c) for c in coefficients)
        return Mode(circles, l, omega, k, (first, second, third, fourth), disc)

    raw = scaled(1.0)
    a = disc.inner_radius
    b = disc.outer_radius
    r = 0.5 * (b - a) * (_NODES + 1.0) + a
    around = math.pi if l else 2.0 * math.pi
    mass = disc.areal * around * 0.5 * (b - a) * float(_WEIGHTS @ (_shape(raw, r) ** 2 * r))
    return scaled(math.copysign(1.0 / math.sqrt(mass), raw.at(b)))


@cache
def _at(mode: Mode, radius: float) -> float:
    return float(_shape(mode, np.array([radius]))[0])


def _shape(mode: Mode, r: Array) -> Array:
    """The shape R [kg^-0.5] at radii [m]."""
    wavenumbers = np.full(len(r), mode.wavenumber)
    values, _ = _functions(mode.disc, mode.diameters, wavenumbers, r)
    return np.asarray(values @ mode.coefficients)
