"""Exact propagation within a mode set: quiet ticks, and the ticks that must be opened.

A quiet tick is one product y = x + E x with a proof that no guard fell in it. A tick without that proof is opened:
cells of step / 2^j from the ladder, left to right, as coarse as alignment and certificate allow; in a finest cell every
guard is a Taylor polynomial whose first fall is found. After an event the state goes by Taylor to the next grid point
and the ladder climbs again. Event times are exact to rounding at every step size.
"""

from __future__ import annotations

from rig.kernel import inlined, inner, local
from rig.solve.emit import emit_linear
from rig.solve.forces import dot, rounding
from rig.solve.ledger import book
from rig.solve.roots import NONE, first_fall
from rig.solve.settle import passed
from rig.solve.wide import along as along_cell
from rig.solve.wide import book as book_part
from rig.solve.wide import earliest as fall_of
from rig.solve.wide import emit as emit_cells
from rig.solve.wide import expand


@inner
def quiet(shape, E, G, B, count, x, g, ticks, out):
    """Up to `ticks` certified ticks from x in place; out[i] receives the state after tick i. Returns their number.

    `shape`: a tuple of n zeros, so that n is a constant of the compiled code. `g`: guards at x, updated in place.
    """
    n = len(shape)
    here, y = local(shape, x), local(shape, x)
    for i in range(n):
        here[i] = x[i]
    done = ticks
    for tick in range(ticks):
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += E[i, j] * here[j]
            y[i] = here[i] + s
        certain = True
        for k in range(count):
            after, bound = 0.0, 0.0
            for j in range(n):
                after += G[k, j] * y[j]
                bound += B[k, j] * abs(here[j])
            certain = certain and g[k] > bound and after > bound
            g[k] = after
        if not certain:
            done = tick
            break
        for i in range(n):
            out[tick, i] = here[i] = y[i]
    for i in range(n):
        x[i] = here[i]
    for k in range(count):
        g[k] = dot(G[k], x)
    return done


@inlined
def product(shape, row, x):
    """Row . x, n a constant of the compiled code."""
    s = 0.0
    for j in range(len(shape)):
        s += row[j] * x[j]
    return s


@inner
def series(shape, A, x, length, terms, derivatives):
    """derivatives[k] = A^k x length^k / k!, k = 0 .. terms."""
    n = len(shape)
    for i in range(n):
        derivatives[0, i] = x[i]
    for k in range(1, terms + 1):
        f = length / k
        for i in range(n):
            derivatives[k, i] = f * product(shape, A[i], derivatives[k - 1])


@inner
def along(shape, derivatives, terms, u, x):
    """X = sum_k derivatives[k] u^k."""
    for i in range(len(shape)):
        s = derivatives[terms, i]
        for k in range(terms - 1, -1, -1):
            s = s * u + derivatives[k, i]
        x[i] = s


@inlined
def certified(shape, t, slot, x, y, shrink):
    """Whether no guard can fall between x and y, the ends of a cell `shrink` = 4^-level of a step."""
    for k in range(t.guards[slot]):
        before, after = product(shape, t.G[slot, k], x), product(shape, t.G[slot, k], y)
        bound, slope_bound = 0.0, 0.0
        for j in range(len(shape)):
            bound += t.B[slot, k, j] * abs(x[j])
            slope_bound += t.BA[slot, k, j] * abs(x[j])
        if before > bound * shrink and after > bound * shrink:
            continue
        rising = (
            product(shape, t.GA[slot, k], x) > slope_bound * shrink
            and product(shape, t.GA[slot, k], y) > slope_bound * shrink
        )
        if rising and before >= -rounding(t.G[slot, k], x):
            continue
        falling = (
            product(shape, t.GA[slot, k], x) < -slope_bound * shrink
            and product(shape, t.GA[slot, k], y) < -slope_bound * shrink
        )
        if not (falling and after > 0.0):
            return False
    return True


@inlined
def earliest(shape, t, slot, size, derivatives, terms, poly, work):
    """First fall of any guard along a Taylor cell: (u in [0, 1] or NONE, guard)."""
    first, guard = NONE, -1
    for k in range(t.guards[slot]):
        for d in range(terms + 1):
            poly[d] = product(shape, t.G[slot, k], derivatives[d])
        u = first_fall(poly, terms, rounding(t.G[slot, k], size), work)
        if u < first:
            first, guard = u, k
    return first, guard


@inlined
def opened(shape, wide, t, slot, ic, fc, x, w, energy, booking, emit, seg, origin):
    """Carry x through (the rest of) one tick, up to its end or the first event.

    fc[0] = u, where in the tick; advanced. Returns the guard that fell, or -1 at the end of the tick. `w`: Workspace.
    `emit`: write segments for the sensors, `origin`: start of this tick [s] within the frame. `wide`: see carry.
    """
    h = t.step[0]
    depth, terms = t.depth[slot], t.order[slot]
    cells = 2.0**depth
    u = fc[0]
    while u < 1.0:
        position = u * cells
        whole = int(position)
        level = depth
        partial = position != whole
        if not partial:
            while level > 0 and whole % 2 == 0 and u + 2.0 / 2.0**level <= 1.0:
                whole //= 2
                level -= 1
            found = False
            while wide is None or depth > 0:  # a wide rig's tick has just been found to have no proof
                for i in range(len(shape)):
                    w.y[i] = x[i] + product(shape, t.E[slot, level, i], x)
                if certified(shape, t, slot, x, w.y, 1.0 / 4.0**level):
                    found = True
                    break
                if level == depth:
                    break
                level += 1
            if found:
                width = 1.0 / 2.0**level
                if emit:
                    if wide is not None:
                        emit_cells(t, slot, x, width * cells, origin + u * h, width * h, seg)
                    else:
                        emit_linear(t, slot, x, origin + u * h, width * h, seg, w.derivatives)
                if booking:
                    book(t.work[slot, level], t.active[slot], x, energy)
                for i in range(len(shape)):
                    x[i] = w.y[i]
                u += width
                continue
        length = (int(position) + 1) / cells - u
        if wide is not None:
            fall, guard = fall_of(t, slot, x, w.size, length * cells, w.poly, w.roots)
            expand(t, slot, x)
        else:
            series(shape, t.A[slot], x, length * h, terms, w.derivatives)
            fall, guard = earliest(shape, t, slot, w.size, w.derivatives, terms, w.poly, w.roots)
        reach = 1.0 if guard < 0 else fall
        if reach > 0.0:
            if emit:
                if wide is not None:
                    emit_cells(t, slot, x, reach * length * cells, origin + u * h, reach * length * h, seg)
                else:
                    emit_linear(t, slot, x, origin + u * h, reach * length * h, seg, w.spare)
            if booking:
                if wide is not None:
                    book_part(t, slot, reach * length * cells, reach * length * h)
                else:
                    book_series(shape, t, slot, w, terms, reach, length * h, energy)
            if wide is not None:
                along_cell(t, reach * length * cells)
                for i in range(len(shape)):
                    x[i] = t.wide.filled[i]
            else:
                along(shape, w.derivatives, terms, reach, x)
        u = u + reach * length if guard >= 0 else (int(position) + 1) / cells
        if guard >= 0:
            fc[0] = u
            passed(t, slot, guard, ic, x)
            return guard
    fc[0] = 0.0
    return -1


@inner
def book_series(shape, t, slot, w, terms, reach, length, energy):
    """Energy along a Taylor cell up to `reach`, by Gauss-Legendre at eight nodes."""
    for q in range(w.nodes.shape[0]):
        along(shape, w.derivatives, terms, w.nodes[q] * reach, w.y)
        scale = w.weights[q] * reach * length
        for term in range(energy.shape[0]):
            if t.active[slot, term]:
                s = 0.0
                for i in range(w.y.shape[0]):
                    s += w.y[i] * dot(t.powers[slot, term, i], w.y)
                energy[term] += scale * s
