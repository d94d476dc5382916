"""The modes that agree with the equations at one instant.

Settled at the start of a run, after every event and at the start of every block (a held command may have jumped):
change a mode, look up its slot, land on the constraint, look again, until nothing changes. A step that ends on w = 0
decides by the force that sticking would need, never by the sign of a rounded w. Nothing is landed at a jump of the
belt: a stuck body whose belt jumps slips, and no energy moves by itself.
"""

from __future__ import annotations

from rig.kernel import inlined, inner
from rig.solve.formulation import (
    G_CLOSE,
    G_LIMIT_BACK,
    G_LIMIT_LOW,
    G_OPEN,
    G_RELEASE_PLUS,
    G_SLIP,
    SLIP_MINUS,
    SLIP_PLUS,
    STICK,
)
from rig.solve.laws import mu

DONE, NEED, CHATTER, JAM, LOST, OVERFULL = range(6)  # what a kernel returns
READY, SETTLE, LAND, START = range(4)  # what a run has to do first

_ROUND = 64.0 * 2.2e-16
_SLACK = 1e-9  # a contact that slips and sticks in the same instant may hold this much more


@inner
def dot(row, x):
    """Row . x, summed in index order."""
    s = 0.0
    for j in range(row.shape[0]):
        s += row[j] * x[j]
    return s


@inner
def rounding(row, x):
    """Size of the rounding error of row . x."""
    s = 0.0
    for j in range(row.shape[0]):
        s += abs(row[j] * x[j])
    return s * _ROUND


@inlined
def friction(sigma, code, numbers, slip, load, load_t, coupled, x, T, scratch):
    """Friction forces T[patch] of the slipping patches with a law over speed (0 for the others); all of one slot.

    T = sigma mu(sigma w) N with N = load x + load_t T. `coupled`: some load does depend on T.
    """
    for p in range(T.shape[0]):
        if sigma[p] != 0.0 and code[p] != 0:
            w, N = 0.0, 0.0
            for j in range(x.shape[0]):
                w += slip[p, j] * x[j]
                N += load[p, j] * x[j]
            T[p] = sigma[p] * mu(code[p], numbers[p], sigma[p] * w) * N
        else:
            T[p] = 0.0
    if coupled:
        couple(sigma, code, numbers, slip, load_t, x, T, scratch)


@inner
def couple(sigma, code, numbers, slip, load_t, x, T, M):
    """Solve T = T0 + diag(sigma mu) load_t T for T, in place of T0; M is scratch.

    Elimination without pivoting: the matrix is one plus a small coupling.
    """
    P = T.shape[0]
    for p in range(P):
        m = 0.0
        if sigma[p] != 0.0 and code[p] != 0:
            m = sigma[p] * mu(code[p], numbers[p], sigma[p] * dot(slip[p], x))
        for r in range(P):
            M[p, r] = -m * load_t[p, r]
        M[p, p] += 1.0
    for p in range(P):
        for q in range(p + 1, P):
            f = M[q, p] / M[p, p]
            for r in range(p, P):
                M[q, r] -= f * M[p, r]
            T[q] -= f * T[p]
    for p in range(P - 1, -1, -1):
        for r in range(p + 1, P):
            T[p] -= M[p, r] * T[r]
        T[p] /= M[p, p]


@inner
def digit(key, base, radix):
    """One mode of a mixed-radix key."""
    return (key // base) % radix


@inner
def with_digit(key, base, radix, mode):
    """The key with one mode replaced."""
    return key + (mode - digit(key, base, radix)) * base


@inner
def of_patch(p):
    """Weight of the mode of patch p in the key."""
    return 3**p


@inner
def of_normal(P, k):
    """Weight of the mode of normal k, behind P patches."""
    return 3**P * 2**k


@inner
def of_limiter(P, K, x):
    """Weight of the mode of limiter x, behind P patches and K normals."""
    return 3**P * 2**K * 3**x


@inlined
def land(t, slot, x, copy):
    """X <- Pi x: take what is left of the slip speed out of stuck patches."""
    n = x.shape[0]
    for i in range(n):
        copy[i] = x[i]
    for i in range(n):
        x[i] = dot(t.landing[slot, i], copy)


@inner
def loaded(patch_of, P, key, p):
    """Whether any normal force of patch p is closed."""
    for k in range(patch_of.shape[0]):
        if patch_of[k] == p and digit(key, of_normal(P, k), 2) == 0:
            return True
    return False


@inner
def choose(slip, key, p, x, size):
    """The key with patch p in stick where it does not slip, else in slip along its speed."""
    w = dot(slip[p], x)
    if abs(w) <= rounding(slip[p], size):
        return with_digit(key, of_patch(p), 3, STICK)
    return with_digit(key, of_patch(p), 3, SLIP_PLUS if w > 0.0 else SLIP_MINUS)


@inner
def transition(kind, owner, P, K, key):
    """The mode set that follows when a guard of `kind` falls through zero."""
    if kind == G_SLIP:
        return with_digit(key, of_patch(owner), 3, STICK)
    if kind < G_OPEN:
        return with_digit(key, of_patch(owner), 3, SLIP_PLUS if kind == G_RELEASE_PLUS else SLIP_MINUS)
    if kind <= G_CLOSE:
        return with_digit(key, of_normal(P, owner), 2, 1 if kind == G_OPEN else 0)
    mode = 0 if kind == G_LIMIT_BACK else (1 if kind == G_LIMIT_LOW else 2)
    return with_digit(key, of_limiter(P, K, owner), 3, mode)


@inlined
def disagreement(t, slot, key, x, size, T, slack):
    """The first mode that the state contradicts, as the key that mends it; -1 when all agree.

    A patch that slips with w inside rounding agrees: it has just been released. Friction is asked before the normal
    forces: where N depends on the acceleration, a stuck contact that would pull lets go and then presses; opened first,
    it would press in the open, stick again, and never be done.
    """
    P, K = t.slip.shape[0], t.of_patch.shape[0]
    for p in range(P):
        if not loaded(t.of_patch, P, key, p):
            continue
        base = of_patch(p)
        w, noise = dot(t.slip[p], x), rounding(t.slip[p], size)
        mode = digit(key, base, 3)
        if mode == STICK:
            if abs(w) > noise:
                return with_digit(key, base, 3, SLIP_PLUS if w > 0.0 else SLIP_MINUS)
            need = dot(t.friction[slot, p], x) + dot(t.friction_t[slot, p], T)
            limit = t.static[p] * (dot(t.load[slot, p], x) + dot(t.load_t[slot, p], T))
            if abs(need) > limit * (1.0 + slack):
                return with_digit(key, base, 3, SLIP_PLUS if need > 0.0 else SLIP_MINUS)
        elif (w if mode == SLIP_PLUS else -w) < -noise:
            return with_digit(key, base, 3, SLIP_PLUS if w > 0.0 else SLIP_MINUS)
    for k in range(K):
        N = dot(t.normal[slot, k], x) + dot(t.normal_t[slot, k], T)
        noise = rounding(t.normal[slot, k], size)
        base, p = of_normal(P, k), t.of_patch[k]
        if digit(key, base, 2) == 0:
            if N < -noise:
                return with_digit(key, base, 2, 1)
        elif N > noise:
            was_loaded = loaded(t.of_patch, P, key, p)
            new = with_digit(key, base, 2, 0)
            return new if was_loaded else choose(t.slip, new, p, x, size)
    for g in range(t.guards[slot]):
        if t.kind[slot, g] > G_CLOSE and dot(t.G[slot, g], x) < -rounding(t.G[slot, g], x):
            return transition(t.kind[slot, g], t.owner[slot, g], P, K, key)
    return -1


@inner
def settle(t, ic, x, size, T, scratch, copy, repeat):
    """Bring the modes of `ic` (see motion: key, pending work) into agreement with x. Returns DONE, NEED or JAM.

    `size` holds the largest sizes of the states so far: a slip speed that is only their rounding is none, also where
    belt and body have come to rest. `repeat`: the same contact has just changed twice in one instant; sticking may
    then hold a little more.
    """
    key, pending = ic[1], ic[2]
    for i in range(x.shape[0]):
        size[i] = max(size[i], abs(x[i]))
    if pending == START:
        for p in range(t.slip.shape[0]):
            key = choose(t.slip, key, p, x, size)
        pending = LAND
    slack = _SLACK if repeat else 0.0
    for _ in range(4 * (t.slip.shape[0] + t.of_patch.shape[0]) + 12):
        slot = t.slot_of[key]
        if slot < 0:
            ic[1], ic[2] = key, pending
            return NEED
        if pending == LAND:
            land(t, slot, x, copy)
            pending = SETTLE
        if t.falling[slot]:
            friction(
                t.sigma[slot], t.code, t.numbers, t.slip, t.load[slot], t.load_t[slot], t.coupled[slot], x, T, scratch
            )
        else:
            for p in range(T.shape[0]):
                T[p] = 0.0
        new = disagreement(t, slot, key, x, size, T, slack)
        if new < 0:
            ic[1], ic[2] = key, READY
            return DONE
        for p in range(t.slip.shape[0]):  # a patch that has just begun to stick lands
            if digit(new, of_patch(p), 3) == STICK and digit(key, of_patch(p), 3) != STICK:
                pending = LAND
        key = new
    ic[1] = key
    return JAM
