"""The modes that agree with the equations at one instant.

Settled at the start of a run, after every event and at the start of a block where a state was written (a held command
may have jumped): change a mode, look up its mode set, land on the constraint, look again, until nothing changes. A step
that ends on w = 0 decides by the force that sticking would need, never by the sign of a rounded w. Nothing is landed at
a jump of the belt: a stuck body whose belt jumps slips, and no energy moves by itself. A switch that was thrown takes
its position here; what the network then stores less is booked.
"""

from __future__ import annotations

from rig.kernel import inlined, inner
from rig.solve.energy_balance import SWITCH, held
from rig.solve.forces import inputs
from rig.solve.friction_coefficient import SMOOTH
from rig.solve.records import BEGUN, KEY, PENDING, REPEAT
from rig.solve.rows import ROUND, dot, rounding
from rig.solve.state_codes import (
    G_CLOSE,
    G_LIMIT_BACK,
    G_LIMIT_LOW,
    G_NEXT,
    G_OPEN,
    G_RELEASE_PLUS,
    G_SLIP,
    SLIP_MINUS,
    SLIP_PLUS,
    STICK,
)

# What a kernel returns. NEED: a mode set; OVERFULL: more room for segments; LOOK: done, maybe early.
DONE, NEED, CHATTER, JAM, LOST, OVERFULL, LOOK = range(7)
READY, SETTLE, LAND, START, THROWN = range(5)  # what a run has to do first

_SLACK = 1e-9  # a contact that slips and sticks in the same instant may hold this much more


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


@inner
def of_sector(t, s):
    """Weight of the mode of sector row s, behind patches, normals and limiters."""
    weight = 3 ** t.slip.shape[0] * 2 ** t.of_patch.shape[0] * 3 ** t.limiters[0]
    for i in range(s):
        weight *= t.sectors[i]
    return weight


@inner
def thrown(t, key, x):
    """The key with every switch in the position that its signal says."""
    weight = of_sector(t, t.sectors.shape[0])
    for s in range(t.positions.shape[0]):
        where = min(max(int(x[t.commanded[s]] + 0.5), 0), t.positions[s] - 1)
        key += (where - (key // weight) % t.positions[s]) * weight
        weight *= t.positions[s]
    return key


@inlined
def land(t, mode_set, x, copy):
    """X <- Pi x: take what is left of the slip speed out of stuck patches."""
    n = x.shape[0]
    for i in range(n):
        copy[i] = x[i]
    for i in range(n):
        x[i] = dot(t.landing[mode_set, i], copy)


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


@inner
def passed(t, mode_set, guard, ic, x):
    """What follows when a guard of `mode set` falls: the next key to `ic`, modes to be settled anew.

    A place that rounding has left short of the edge is put on it, or its new sector would be left at once. Beyond the
    ends of the range of sectors the place is moved by a period.
    """
    kind, owner, key = t.kind[mode_set, guard], t.owner[mode_set, guard], ic[KEY]
    ic[PENDING] = LAND
    if kind < G_NEXT:
        ic[KEY] = transition(kind, owner, t.slip.shape[0], t.of_patch.shape[0], key)
        return
    base, count = of_sector(t, owner), t.sectors[owner]
    mode = digit(key, base, count) + (1 if kind == G_NEXT else -1)
    left = t.edges[owner, mode if kind == G_NEXT else mode + 1] - dot(t.path[owner], x)
    if (left > 0.0) == (kind == G_NEXT):
        x[t.turn[owner]] += left
    if mode == count:
        mode = 0
        x[t.turn[owner]] -= t.edges[owner, count]
    elif mode < 0:
        mode = count - 1
        x[t.turn[owner]] += t.edges[owner, count]
    ic[KEY] = with_digit(key, base, count, mode)


@inlined
def place(t, key, x):
    """The key with every sector where x is."""
    for s in range(t.sectors.shape[0]):
        at, mode = dot(t.path[s], x), 0
        while mode + 1 < t.sectors[s] and at >= t.edges[s, mode + 1]:
            mode += 1
        key = with_digit(key, of_sector(t, s), t.sectors[s], mode)
    return key


@inlined
def turns_back(t, mode_set, p, sign, x, T):
    """Whether dw/dt of patch p, which is to slip along `sign` from w = 0, clearly points the other way."""
    rate, size = 0.0, 0.0
    for i in range(x.shape[0]):
        if t.slip[p, i] != 0.0:
            rate += t.slip[p, i] * (dot(t.A[mode_set, i], x) + dot(t.b[mode_set, i], T))
            size += abs(t.slip[p, i]) * (rounding(t.A[mode_set, i], x) + rounding(t.b[mode_set, i], T))
    return sign * rate < -_SLACK / ROUND * size


@inlined
def disagreement(t, mode_set, key, begun, x, size, T, slack):
    """The first mode that the state contradicts, as the key that mends it; -1 when all agree.

    A patch that slips with w inside rounding agrees: it has just been released, or an event of its own will end that.
    If it was put there since the modes were `begun`, w has to grow. Contacts are asked in their order, from the first
    again after every change: several that change together at one instant are a complementarity problem, and this is
    Murty's rule of the least index, which does not go round in circles where other orders do (Opsearch 11 (1974) 123).
    Friction is asked before the normal forces: where N depends on the acceleration, a stuck contact that would pull
    lets go and then presses; opened first, it would press in the open, stick again, and never be done. A contact that
    cannot open pulls as it presses, here as between two blocks.
    """
    P, K = t.slip.shape[0], t.of_patch.shape[0]
    for p in range(P):
        if not loaded(t.of_patch, P, key, p):
            continue
        base = of_patch(p)
        w, noise = dot(t.slip[p], x), rounding(t.slip[p], size)
        mode = digit(key, base, 3)
        if t.code[mode_set, p] == SMOOTH:  # alike to both sides, and never stuck
            if mode == SLIP_PLUS:
                continue
            return with_digit(key, base, 3, SLIP_PLUS)
        if mode == STICK:
            if abs(w) > noise:
                return with_digit(key, base, 3, SLIP_PLUS if w > 0.0 else SLIP_MINUS)
            need = dot(t.friction[mode_set, p], x) + dot(t.friction_t[mode_set, p], T)
            limit = t.static[mode_set, p] * (dot(t.load[mode_set, p], x) + dot(t.load_t[mode_set, p], T))
            if abs(need) > limit * (1.0 + slack):
                return with_digit(key, base, 3, SLIP_PLUS if need > 0.0 else SLIP_MINUS)
        elif (w if mode == SLIP_PLUS else -w) < -noise:
            return with_digit(key, base, 3, SLIP_PLUS if w > 0.0 else SLIP_MINUS)
        elif abs(w) <= noise and digit(begun, base, 3) != mode:
            if turns_back(t, mode_set, p, 1.0 if mode == SLIP_PLUS else -1.0, x, T):
                return with_digit(key, base, 3, STICK)
    for k in range(K):
        if not t.opens[k]:
            continue
        N = dot(t.normal[mode_set, k], x) + dot(t.normal_t[mode_set, k], T)
        noise = rounding(t.normal[mode_set, k], size)
        base, p = of_normal(P, k), t.of_patch[k]
        if digit(key, base, 2) == 0:
            if N < -noise:
                return with_digit(key, base, 2, 1)
        elif N > noise:
            was_loaded = loaded(t.of_patch, P, key, p)
            new = with_digit(key, base, 2, 0)
            return new if was_loaded else choose(t.slip, new, p, x, size)
    for g in range(t.guards[mode_set]):
        if G_CLOSE < t.kind[mode_set, g] < G_NEXT and dot(t.G[mode_set, g], x) < -rounding(t.G[mode_set, g], x):
            return transition(t.kind[mode_set, g], t.owner[mode_set, g], P, K, key)
    return -1


@inlined
def settle(t, w, state):
    """Bring the modes of `state` into agreement with its x. Returns DONE, NEED or JAM.

    A slip speed that is only the rounding of the largest sizes of the states so far (w.size) is none, also where belt
    and body have come to rest. Where the same contact has just changed twice in one instant (ic[REPEAT]), sticking may
    hold a little more.
    """
    ic, x, size, T, scratch, copy, energy = state.ic, state.x, w.size, w.T, w.scratch, w.copy, state.energy
    key, pending = ic[KEY], ic[PENDING]
    for i in range(x.shape[0]):
        size[i] = max(size[i], abs(x[i]))
    if pending == START:
        for p in range(t.slip.shape[0]):
            key = choose(t.slip, key, p, x, size)
        key = thrown(t, place(t, key, x), x)
        pending = LAND
    elif thrown(t, key, x) != key:
        energy[SWITCH] += held(t.store[t.mode_set_of[key]], x)
        key, pending = thrown(t, key, x), THROWN
    slack, begun = _SLACK if ic[REPEAT] > 1 else 0.0, ic[BEGUN] if ic[BEGUN] >= 0 else key
    for _ in range(4 * (t.slip.shape[0] + t.of_patch.shape[0]) + 12):
        mode_set = t.mode_set_of[key]
        if mode_set < 0:
            ic[KEY], ic[PENDING], ic[BEGUN] = key, pending, begun
            return NEED
        if pending != SETTLE:
            if t.lands[mode_set]:
                land(t, mode_set, x, copy)
            if pending == THROWN:
                energy[SWITCH] -= held(t.store[mode_set], x)
            pending = SETTLE
        if t.curved[mode_set]:
            inputs(t, mode_set, x, T, scratch)
        else:
            for p in range(T.shape[0]):
                T[p] = 0.0
        new = disagreement(t, mode_set, key, begun, x, size, T, slack)
        if new < 0:
            ic[KEY], ic[PENDING], ic[BEGUN] = key, READY, -1
            return DONE
        for p in range(t.slip.shape[0]):  # a patch that has just begun to stick lands
            if digit(new, of_patch(p), 3) == STICK and digit(key, of_patch(p), 3) != STICK:
                pending = LAND
        key = new
    ic[KEY], ic[BEGUN] = key, -1
    return JAM
