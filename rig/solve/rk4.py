"""The classical Runge-Kutta method at a fixed step, events by bisection: the papers' own.

One-sided sign tests at step ends, so a stick phase shorter than the step is missed; that is the method's nature and
the reason it is not the default. It serves comparison, and it serves every mode set alike.
"""

from __future__ import annotations

from rig.kernel import inlined, inner
from rig.solve.books import book, lend_books, read
from rig.solve.emit import emit_quartic
from rig.solve.forces import forces, guard, lend, rate, rounding, slope
from rig.solve.settle import land, passed


@inlined
def move(shape, f, curved, k, x, h, y, z):
    """One step of length h from x, whose derivative k[0] is known: its end y; z is scratch."""
    n = len(shape)
    for stage in range(3):
        reach = h if stage == 2 else 0.5 * h
        for i in range(n):
            z[i] = x[i] + reach * k[stage, i]
        rate(shape, f, curved, z, k[stage + 1])
    for i in range(n):
        y[i] = x[i] + (h / 6.0) * (k[0, i] + 2.0 * (k[1, i] + k[2, i]) + k[3, i])


@inner
def noise(f, g, x):
    """Size of the rounding error of guard g at x, whose inputs are f.T where the guard needs them."""
    size = rounding(f.G[g], x)
    if f.needs[g]:
        size = max(size, rounding(f.GT[g], f.T))
    return size


@inlined
def fell(f, x, y):
    """The first guard that is not positive at y though it was at x, or has clearly fallen; -1 if none."""
    fallen = -1
    for g in range(f.G.shape[0]):
        if fallen < 0 and guard(f, g, y) <= 0.0:
            if guard(f, g, x) > noise(f, g, x) or guard(f, g, y) < -noise(f, g, y):
                fallen = g
    return fallen


@inner
def bisect(shape, f, curved, k, x, h, y, z):
    """Shorten the step until the first guard is zero to rounding: its length, y at that instant."""
    low, high = 0.0, h
    for _ in range(60):
        middle = 0.5 * (low + high)
        if middle <= low or middle >= high:
            break
        move(shape, f, curved, k, x, middle, y, z)
        if fell(f, x, y) >= 0:
            high = middle
        else:
            low = middle
    move(shape, f, curved, k, x, high, y, z)
    return high


@inner
def between(shape, k, x, y, h, u, z):
    """Z = the cubic through x and y with the slopes k[0] and k[1], at u."""
    a, b = 2.0 * u * u * u - 3.0 * u * u + 1.0, u * u * u - 2.0 * u * u + u
    c, d = 1.0 - a, u * u * u - u * u
    for i in range(len(shape)):
        z[i] = a * x[i] + c * y[i] + h * (b * k[0, i] + d * k[1, i])


@inner
def observe(shape, f, b, k, x, y, h, z, start, booking, energy, emitting, values, seg):
    """Energy (Simpson) and signals along a step from x to y, whose slopes are k[0] and k[1]."""
    for q in range(5):
        between(shape, k, x, y, h, 0.25 * q, z)
        forces(f, z)
        if booking and q % 2 == 0:
            book(b, z, (4.0 if q == 2 else 1.0) * h / 6.0, energy)
        if emitting:
            read(b, z, values[q])
    if emitting and h > 0.0:
        emit_quartic(values, start, h, seg)


@inner
def stretch(shape, t, slot, ic, fc, x, w, origin, ticks, substeps, out, modes, energy, booking, emitting, seg):
    """Carry x until an event or the end of the ticks asked for, `substeps` steps a tick. Returns the guard or -1."""
    n = len(shape)
    full = t.step[0] / substeps
    f, b = lend(t, slot, w.T, w.scratch), lend_books(t, slot, w.T)
    k, y, z = w.k, w.y, w.y2
    curved = t.curved[slot] != 0
    while ic[0] < ticks:
        position = fc[0] * substeps
        whole = int(position + 1e-12) + 1
        h = full if position - (whole - 1) <= 1e-12 else (whole - position) * full
        rate(shape, f, curved, x, k[0])
        move(shape, f, curved, k, x, h, y, z)
        fallen = fell(f, x, y)
        length = h
        if fallen >= 0:
            length = bisect(shape, f, curved, k, x, h, y, z)
            fallen = max(fell(f, x, y), 0)
        if booking or emitting:
            slope(shape, f, curved, y, k[1])
            start = (ic[0] - origin + fc[0]) * t.step[0]
            observe(shape, f, b, k, x, y, length, z, start, booking, energy, emitting, w.values, seg)
        for i in range(n):
            x[i] = y[i]
        if t.stuck[slot]:
            land(t, slot, x, w.copy)
        if fallen >= 0:
            fc[0] = min((position + length / full) / substeps, 1.0 - 1.2e-16)
            passed(t, slot, fallen, ic, x)
            return fallen
        if whole >= substeps:
            for i in range(n):
                out[ic[0], i] = x[i]
            modes[ic[0]] = slot
            ic[0] += 1
            fc[0] = 0.0
        else:
            fc[0] = whole / substeps
    return -1
