"""The classical Runge-Kutta method at a fixed step, events by bisection: the papers' own.

One-sided sign tests at step ends, so a stick phase shorter than the step is missed; that is the method's nature and
the reason it is not the default. It serves comparison, and it serves every mode set alike.
"""

from __future__ import annotations

from rig.kernel import inlined, inner, local
from rig.solve.books import book, lend_books, read
from rig.solve.emit import crowded, emit_quartic
from rig.solve.forces import forces, guard, lend, rate, rounding
from rig.solve.settle import land, passed


@inlined
def move(shape, f, bent, k, x, h, y, z):
    """One step of length h from x, whose derivative k[0] is known: its end y; z is scratch."""
    n = len(shape)
    for stage in range(3):
        reach = h if stage == 2 else 0.5 * h
        for i in range(n):
            z[i] = x[i] + reach * k[stage, i]
        rate(shape, f, bent, z, k[stage + 1])
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
def fell(shape, f, bent, x, y):
    """The first guard that is not positive at y though it was at x, or has clearly fallen; -1 if none."""
    fallen = -1
    for g in range(f.G.shape[0]):
        if fallen < 0 and guard(shape, f, bent, g, y) <= 0.0:
            if guard(shape, f, bent, g, x) > noise(f, g, x) or guard(shape, f, bent, g, y) < -noise(f, g, y):
                fallen = g
    return fallen


@inner
def bisect(shape, f, bent, x, h, w):
    """Shorten the step from x until the first guard is zero to rounding: its length and that guard; the end in w.y."""
    k, y, z = local(shape, w.k), local(shape, w.y), local(shape, w.y2)
    rate(shape, f, bent, x, k[0])
    low, high = 0.0, h
    for _ in range(60):
        middle = 0.5 * (low + high)
        if middle <= low or middle >= high:
            break
        move(shape, f, bent, k, x, middle, y, z)
        if fell(shape, f, bent, x, y) >= 0:
            high = middle
        else:
            low = middle
    move(shape, f, bent, k, x, high, y, z)
    for i in range(len(shape)):
        w.y[i] = y[i]
    return high, max(fell(shape, f, bent, x, y), 0)


@inner
def between(shape, k, x, y, h, u, z):
    """Z = the cubic through x and y with the slopes k[0] and k[1], at u."""
    a, b = 2.0 * u * u * u - 3.0 * u * u + 1.0, u * u * u - 2.0 * u * u + u
    c, d = 1.0 - a, u * u * u - u * u
    for i in range(len(shape)):
        z[i] = a * x[i] + c * y[i] + h * (b * k[0, i] + d * k[1, i])


@inner
def observe(shape, f, b, bent, x, h, w, start, booking, energy, emitting, seg):
    """Energy (Simpson) and signals along a step from x to w.y."""
    rate(shape, f, bent, x, w.k[0])
    rate(shape, f, bent, w.y, w.k[1])
    for q in range(5):
        between(shape, w.k, x, w.y, h, 0.25 * q, w.y2)
        forces(f, w.y2)
        if booking and q % 2 == 0:
            book(b, w.y2, (4.0 if q == 2 else 1.0) * h / 6.0, energy)
        if emitting:
            read(b, w.y2, w.values[q])
    if emitting and h > 0.0:
        emit_quartic(w.values, start, h, seg)


@inner
def stretch(shape, t, slot, ic, fc, x, w, origin, ticks, substeps, out, modes, energy, booking, emitting, seg, bent):
    """Carry x until an event or the end of the ticks asked for, `substeps` steps a tick. Returns the guard or -1.

    `bent`: None for a system that is linear in every mode set.
    """
    n = len(shape)
    full = t.step[0] / substeps
    f, b = lend(t, slot, w.T, w.scratch), lend_books(t, slot, w.T)
    k, y, z = local(shape, w.k), local(shape, w.y), local(shape, w.y2)
    tick, place = ic[0], fc[0]
    fallen = -1
    while tick < ticks and fallen < 0 and not (emitting and crowded(t, slot, seg, ticks - tick)):
        position = place * substeps
        whole = int(position + 1e-12) + 1
        h = full if position - (whole - 1) <= 1e-12 else (whole - position) * full
        rate(shape, f, bent, x, k[0])
        move(shape, f, bent, k, x, h, y, z)
        fallen = fell(shape, f, bent, x, y)
        length = h
        if fallen >= 0:
            length, fallen = bisect(shape, f, bent, x, h, w)
            for i in range(n):
                y[i] = w.y[i]
        if booking or emitting:
            for i in range(n):
                w.y[i] = y[i]
            start = (tick - origin + place) * t.step[0]
            observe(shape, f, b, bent, x, length, w, start, booking, energy, emitting, seg)
        for i in range(n):
            x[i] = y[i]
        if bent is not None and t.stuck[slot]:
            land(t, slot, x, w.copy)
        reached = position + length / full
        if fallen >= 0 and reached < substeps - 1e-12:
            place = reached / substeps
        elif whole >= substeps:
            for i in range(n):
                out[tick, i] = x[i]
            modes[tick] = slot
            tick += 1
            place = 0.0
        else:
            place = whole / substeps
    ic[0], fc[0] = tick, place
    if fallen >= 0:
        passed(t, slot, fallen, ic, x)
    return fallen
