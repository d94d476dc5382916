"""Closed solutions and reference integrations of friction laws with memory, independent of the product."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]

LUGRE_PULLED = {"x": 1.9088391992254, "v": 9.42415459073e-6, "z": 1.18167954559e-5}
"""A mass of 1 kg at 25 s, pulled by a spring of 2 N/m whose end moves at 0.1 m/s: x, v and the deflection z.

sigma0 1e5 N/m, sigma1 1e5^0.5 N s/m, sigma2 0.4 N s/m, Fc 1 N, Fs 1.5 N, vs 1e-3 m/s. By DOP853 and Radau at relative
tolerances of 2.3e-14 and 1e-12, which agree to 1e-14 in x and 3e-13 in v and z. The published numbers of the same
problem are 1.90883919923 and 1.18167955e-5: Canudas de Wit et al., IEEE Trans. Autom. Control 40 (1995) 419, figure 5.
"""


def elements(
    turns: Sequence[float], at: Array, stiffness: float, limit: float, transition: float
) -> tuple[Array, Array]:
    """A path x through the points `turns`, monotone between them, and the force of one element along it.

    `at`: shares of the way between two points, rising from 0 to 1. In the direction s = +-1 the element sticks,
    F = F0 + s k x, up to (1 - transition) of the limit L in that direction, at x1 = ((1 - transition) L - s F0) / k.
    Beyond it the gap to L decays as d(L - sF)/dx = -k (L - sF) / (transition L), so that
    sF = L (1 - transition exp(-k (x - x1) / (transition L))). A force that starts beyond the stick limit decays from
    there. A transition of 1 is Dahl's law with exponent 1; 0 is the ideal element, whose loops are straight lines.
    """
    path, forces, force = [], [], 0.0
    for start, end in pairwise(turns):
        s = math.copysign(1.0, end - start)
        x = abs(end - start) * at
        stick_limit = (1.0 - transition) * limit
        first = max((stick_limit - s * force) / stiffness, 0.0)
        gap = min(limit - s * force, transition * limit)
        beyond = np.maximum(x - first, 0.0)
        decay = np.exp(-stiffness * beyond / (transition * limit)) if transition else 0.0
        directed = np.where(x <= first, s * force + stiffness * x, limit - gap * decay)
        path.append(start + s * x)
        forces.append(s * directed)
        force = float(forces[-1][-1])
    return np.concatenate(path), np.concatenate(forces)


def dahl(turns: Sequence[float], at: Array, stiffness: float, limit: float, exponent: float) -> tuple[Array, Array]:
    """A path as in `elements`, and Dahl's force along it.

    In the direction s, u = 1 - sF / L obeys du/dx = -(k / L) u^i: u = u0 exp(-k x / L) for i = 1, and else
    u^(1 - i) = u0^(1 - i) + (i - 1) k x / L.
    """
    path, forces, force = [], [], 0.0
    for start, end in pairwise(turns):
        s = math.copysign(1.0, end - start)
        x = abs(end - start) * at
        u = 1.0 - s * force / limit
        if exponent == 1.0:
            left = u * np.exp(-stiffness * x / limit)
        else:
            left = (u ** (1.0 - exponent) + (exponent - 1.0) * stiffness * x / limit) ** (1.0 / (1.0 - exponent))
        path.append(start + s * x)
        forces.append(s * limit * (1.0 - left))
        force = float(forces[-1][-1])
    return np.concatenate(path), np.concatenate(forces)


def aged(start: float, speed: float, t: Array, reference: float, distance: float) -> Array:
    """The state psi = ln(V* theta / Dc) of the ageing law at constant slip `speed`, from psi = `start`.

    theta' = 1 - w theta / Dc is linear: theta = Dc / w + (theta0 - Dc / w) exp(-w t / Dc); at rest theta = theta0 + t.
    """
    theta = distance / reference * math.exp(start)
    if speed == 0.0:
        return np.log(reference / distance * (theta + t))
    steady = distance / speed
    return np.log(reference / distance * (steady + (theta - steady) * np.exp(-speed * t / distance)))


def released(belt: float, displacement: float, end: float, evolution: str) -> tuple[float, float]:
    """Displacement and velocity at the time `end` of a mass that moves with its belt at first, rate and state friction.

    m = 5 kg, k = 2500 N/m, c = 2 N s/m, N = 20 N; mu* = 0.4, V* = 1e-3 m/s, a = 0.02, b = 0.03, D = 4e-5 m. The slip
    speed w is a state, because friction rises within w = 1e-12 m/s:
    m w' = k x + c (V - w) - N a asinh(w / (2 V*) exp((mu* + b psi) / a)), x' = V - w.
    """

    def field(t: float, y: Array) -> list[float]:
        x, w, psi = y
        friction = 20.0 * 0.02 * math.asinh(w / 2e-3 * math.exp((0.4 + 0.03 * psi) / 0.02))
        if evolution == "ageing":
            rate = (1e-3 * math.exp(-psi) - abs(w)) / 4e-5
        else:
            rate = -abs(w) / 4e-5 * (0.5 * math.log((w / 1e-3) ** 2 + 1e-12) + psi)
        return [belt - w, (2500.0 * x + 2.0 * (belt - w) - friction) / 5.0, rate]

    start, floor = [displacement, 0.0, 0.0], [1e-15, 1e-17, 1e-13]
    x, w, _ = solve_ivp(field, (0.0, end), start, method="Radau", rtol=1e-11, atol=floor).y[:, -1]
    return float(x), belt - float(w)


def critical_stiffness(
    mass: float, load: float, a: float, b: float, distance: float, speed: float
) -> tuple[float, float]:
    """Stiffness [N/m] below which steady slip on a spring without damper is unstable, and the frequency there [rad/s].

    Body m x'' = mu N - k x, belt V, w = V - x'. About steady slip both evolution laws give p' = (x' - V p) / Dc for the
    change p of psi, and mu changes by -a x' / V + b p. With x ~ e^(s t):

        m s^3 + (m V / Dc + N a / V) s^2 + (k - N (b - a) / Dc) s + k V / Dc = 0

    A root i f needs c1 c2 = c0 c3, that is k = N (b - a) / Dc (1 + m V^2 / (N a Dc)), and it is
    f^2 = c1 / c3 = (b - a) / a (V / Dc)^2.
    Source: Rice, Ruina, J. Appl. Mech. 50 (1983) 343.
    """
    stiffness = load * (b - a) / distance * (1.0 + mass * speed**2 / (load * a * distance))
    return stiffness, speed / distance * math.sqrt((b - a) / a)


def drift(lowest: float, highest: float, stiffness: float, limit: float) -> float:
    """The drift [m] of LuGre's and Dahl's bristles per slow cycle of a force from `lowest` >= 0 to `highest` < `limit`.

    Slowly, F = k z. While F rises dx = dz / (1 - F / L), while it falls dx = dz / (1 + F / L). With q = F / L a cycle
    gives the integral of 2 q / (1 - q^2) dz, that is L / k ln((1 - q1^2) / (1 - q2^2)). Elasto-plastic bristles have
    dx = dz: no drift.
    """
    return limit / stiffness * math.log((1.0 - (lowest / limit) ** 2) / (1.0 - (highest / limit) ** 2))
