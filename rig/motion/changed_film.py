"""A film whose numbers change in a run: each point keeps its gap and its shear, with forces of the new numbers.

    P = k d + c d'       pressure force of compression d and its rate d', with the new stiffness and damping
    f = k_t e            friction force of shear e; a point whose friction would exceed mu P slips at once

The energy of the springs jumps by dk d^2 / 2 and dk_t e^2 / 2: an impulse in the energy balance. What points lose that
slip at once is friction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.model.film import Film, at
from rig.model.system import System
from rig.solve.film_steps import (
    CENTRE_X,
    CENTRE_Y,
    COUNTED,
    FRACTION,
    FRICTION,
    NORMAL,
    OPEN,
    OPENINGS,
    SLIDES,
    STICKS,
    SUMS,
    FilmTables,
)

Array = NDArray[np.float64]
_NUMBERS = ("rows", "stiffness", "shear", "damping", "mu", "reach")


def follow_change(system: System, tables: FilmTables, step: float, old: System, x: Array) -> float:
    """Change the states of the film in `x` [n], which are those of `old`, to those of `system`.

    `tables`: of the film of `system`, for steps of `step` [s]. Returns the energy [J] that points lose which slip at
    once.
    """
    film = system.film
    before = old.film
    if film is None or before is None or _same(film, before):
        return 0.0
    points = _Points(system, tables, old, x)
    points.press(step)
    lost = points.shear()
    points.push()
    return lost


def _same(film: Film, old: Film) -> bool:
    """Whether two films have the same numbers, so that their states mean the same."""
    alike = film.laws == old.laws and film.tells == old.tells
    return alike and all(np.array_equal(getattr(film, name), getattr(old, name)) for name in _NUMBERS)


class _Points:
    """The points of a film in the order of their states, and these states in `x`."""

    def __init__(self, system: System, tables: FilmTables, old: System, x: Array) -> None:
        assert system.film is not None
        assert old.film is not None
        self._film = system.film
        self._old = old.film
        self._tables = tables
        self._x = x
        self._names = system.names
        self._known = frozenset(old.names)
        self._slide = float(system.signals[tables.slid - system.one] @ x)
        count = len(system.coordinates)
        self._places, self._speeds = x[:count], x[count : 2 * count]
        self._forces = x[tables.first : tables.first + count]
        self._sums = x[tables.first + count : tables.first + count + len(SUMS)]
        rows = self._film.everywhere(float(x[tables.travel]))[..., self._film.order]
        self._normal = rows[0]
        self._sliding = rows[1:]

    def _states(self, kind: str) -> Array:
        """The states of one kind [point], as a view."""
        first = self._names.index(at(kind, int(self._film.order[0])))
        return self._x[first : first + self._film.points]

    def press(self, step: float) -> None:
        """Let the points press with the new stiffness and damping."""
        tables = self._tables
        P = self._states("P")
        place = self._places @ self._normal
        deep = np.maximum(self._seen_ahead(place), 0.0)
        force = tables.stiffness * deep
        if self._film.damping.any():
            resisted = np.maximum(force + self._resistance(place, step), 0.0)
            force = np.where(deep > 0.0, resisted, 0.0)
            self._states("c")[:] = deep
        self._sums[OPENINGS] += COUNTED * np.count_nonzero((P > 0.0) & (force == 0.0))
        P[:] = force

    def _seen_ahead(self, place: Array) -> Array:
        """The compressions for the pressures: extrapolated along the acceleration that these give the slider."""
        tables = self._tables
        count = self._film.points
        pressed = tables.stiff_rows[:, :count] @ np.maximum(place, 0.0)
        ahead = tables.stiffness[0] * tables.advance * pressed
        return np.asarray(place - ahead @ tables.slider_rows[:, :count])

    def _resistance(self, place: Array, step: float) -> Array:
        """The viscous force of each point, by its compression speed of the last step; sets the position before it."""
        film = self._film
        old = self._old
        order = self._film.order
        earlier = self._states("before")
        damping = film.damping[order]
        was = old.damping[order]
        if at("before", 0) not in self._known or not np.array_equal(film.rows, old.rows):
            speed = self._speeds @ self._normal
            earlier[:] = place - step * speed
            return np.asarray(damping * speed)
        P = self._states("P")
        resisted = P - old.stiffness[order] * self._states("c")
        told = (P > 0.0) & (was > 0.0)
        by_force = resisted / np.where(was > 0.0, was, 1.0)
        rate = np.where(told, by_force, (place - earlier) / step)
        return np.asarray(damping * rate)

    def shear(self) -> float:
        """Let the points resist shear with the new stiffness and friction; returns the energy lost by slip at once."""
        tables = self._tables
        order = self._film.order
        kinds = [self._states(kind) for kind in ("f", "g")[: self._film.directions - 1]]
        for force in kinds:
            force *= tables.shear / self._old.shear[order]
        size = np.sqrt(sum(force**2 for force in kinds))
        most = self._most()
        kept = np.minimum(size, most)
        for force in kinds:
            force *= np.divide(kept, size, out=np.ones_like(size), where=size > 0.0)
        if self._film.tells:
            loaded = np.where(size >= most, SLIDES, STICKS)
            self._states("s")[:] = np.where(self._states("P") > 0.0, loaded, OPEN)
        return float(0.5 * np.sum((size**2 - kept**2) * tables.give))

    def _most(self) -> Array:
        """The largest friction of each point [N]; sets slip speed and contact state where the old film has none."""
        film = self._film
        order = self._film.order
        P = self._states("P")
        mu = film.mu[order].copy()
        if not film.tells:
            return mu * P
        speed = self._states("w")
        state = self._states("s")
        if at("w", 0) not in self._known:
            speed[:] = film.reach[order] * self._slide - self._speeds @ self._sliding[0]
            state[:] = np.where(speed == 0.0, STICKS, SLIDES)
        if film.laws:
            for i in np.flatnonzero(state == SLIDES).tolist():
                mu[i] = film.laws[order[i]].mu(abs(float(speed[i])))
        return mu * P

    def push(self) -> None:
        """Set the forces on the coordinates and the sums over the points."""
        tables = self._tables
        P = self._states("P")
        f = self._states("f")
        sums = self._sums
        self._forces[:] = self._sliding[0] @ f - self._normal @ P
        if self._film.directions > 2:
            self._forces[:] += self._sliding[1] @ self._states("g")
        normal = float(P.sum())
        share = P / normal if normal else P
        sums[NORMAL] = normal
        sums[FRICTION] = f.sum()
        sums[FRACTION] = np.mean(P > 0.0)
        sums[CENTRE_X], sums[CENTRE_Y] = tables.places @ share
