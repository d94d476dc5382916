"""The contact state that agrees with the equations at one instant.

It is determined at the start of a run, after every event, and at the start of a block in which a state was written (a
held command may have jumped). One mode is changed, its mode set is looked up, the state is projected onto the
constraint of stick, and all conditions are checked again, until nothing changes. If a step ends at w = 0, the force
needed for sticking decides, never the sign of a rounded w. A jump of the belt speed is not projected: a sticking body
whose belt jumps begins to slip, so no energy is created. A switch that was thrown takes its position here, and the loss
of network energy is added to the energy balance.
"""

from __future__ import annotations

from rig.compiled.kernel import by_address, inlined, inner
from rig.solve.column_blocks import ROUND, copy, dot, rounding
from rig.solve.energy_balance import SWITCH, network_energy
from rig.solve.forces import MEMORY, SMOOTH
from rig.solve.records import (
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
from rig.solve.specialised import any_shape, call

# Status of a kernel. NEED: needs a mode set; OVERFULL: needs more room for segments; LOOK: done, perhaps early.
DONE, NEED, CHATTER, JAM, LOST, OVERFULL, LOOK, UNRESOLVED = range(8)
READY, CHECK, PROJECT, START, THROWN = range(5)  # PROGRESS.pending: the work that precedes advancing the state

_SLACK = 1e-9  # relative increase of the friction limit for a contact that slips and sticks at one instant


@inner
def mode_in_key(key, base, radix):
    """The mode of one contact, read from a mixed-radix key."""
    return (key // base) % radix


@inner
def with_mode(key, base, radix, mode):
    """The key with the mode of one contact replaced."""
    return key + (mode - mode_in_key(key, base, radix)) * base


@inner
def patch_weight(p):
    """Weight of the mode of patch p in the key."""
    return 3**p


@inner
def normal_weight(P, k):
    """Weight of the mode of normal force k in the key; normal forces follow the P patches."""
    return 3**P * 2**k


@inner
def limiter_weight(P, K, x):
    """Weight of the mode of limiter x in the key; limiters follow P patches and K normal forces."""
    return 3**P * 2**K * 3**x


@inner
def sector_weight(t, s):
    """Weight of the mode of sector row s in the key; sector rows follow patches, normal forces and limiters."""
    weight = 3 ** t.slip.shape[0] * 2 ** t.patch_of_normal.shape[0] * 3 ** t.limiters[0]
    for i in range(s):
        weight *= t.sectors[i]
    return weight


@inner
def with_switches_thrown(t, key, x):
    """The key with every switch in the position that its state variable commands."""
    weight = sector_weight(t, t.sectors.shape[0])
    for s in range(t.positions.shape[0]):
        where = min(max(int(x[t.commanded[s]] + 0.5), 0), t.positions[s] - 1)
        key += (where - (key // weight) % t.positions[s]) * weight
        weight *= t.positions[s]
    return key


@inlined
def project_stick(t, mode_set, x, before):
    """Project the state with Pi: remove what is left of the slip speed of stuck patches."""
    copy(x.shape[0], x, before)
    for i in range(x.shape[0]):
        x[i] = dot(t.landing[mode_set, i], before)


@inner
def has_closed_contact(patch_of, P, key, p):
    """Whether at least one normal force of patch p is closed."""
    for k in range(patch_of.shape[0]):
        if patch_of[k] == p and mode_in_key(key, normal_weight(P, k), 2) == 0:
            return True
    return False


@inner
def stick_or_slip(t, key, p, x, size):
    """The key with patch p in stick if its slip speed is zero to rounding, otherwise in slip.

    The sign of the slip speed gives the direction.
    """
    w = dot(t.slip[p], x)
    if abs(w) <= rounding(t.slip[p], size):
        if not t.sticks[p]:
            return with_mode(key, patch_weight(p), 3, SLIP_PLUS)
        return with_mode(key, patch_weight(p), 3, STICK)
    return with_mode(key, patch_weight(p), 3, SLIP_PLUS if w > 0.0 else SLIP_MINUS)


@inner
def key_after_event(kind, owner, P, K, key):
    """The key that follows the event of a guard of `kind`, for all kinds but sectors."""
    if kind == G_SLIP:
        return with_mode(key, patch_weight(owner), 3, STICK)
    if kind < G_OPEN:
        return with_mode(key, patch_weight(owner), 3, SLIP_PLUS if kind == G_RELEASE_PLUS else SLIP_MINUS)
    if kind <= G_CLOSE:
        return with_mode(key, normal_weight(P, owner), 2, 1 if kind == G_OPEN else 0)
    mode = 0 if kind == G_LIMIT_BACK else (1 if kind == G_LIMIT_LOW else 2)
    return with_mode(key, limiter_weight(P, K, owner), 3, mode)


@inner
def apply_event(t, mode_set, guard, now, x):
    """Write the key that follows the event of `guard` to `now` and request a new contact state.

    At the edge of a sector, a position that rounding left short of the edge is moved onto it; otherwise the new sector
    would be left at once. Beyond the last sector, and before the first one, the position is shifted by one period.
    """
    kind, owner, key = t.kind[mode_set, guard], t.owner[mode_set, guard], now.key
    now.pending = PROJECT
    if kind < G_NEXT:
        now.key = key_after_event(kind, owner, t.slip.shape[0], t.patch_of_normal.shape[0], key)
        return
    base, count = sector_weight(t, owner), t.sectors[owner]
    mode = mode_in_key(key, base, count) + (1 if kind == G_NEXT else -1)
    left = t.edges[owner, mode if kind == G_NEXT else mode + 1] - dot(t.path[owner], x)
    if (left > 0.0) == (kind == G_NEXT):
        x[t.turn[owner]] += left
    if mode == count:
        mode = 0
        x[t.turn[owner]] -= t.edges[owner, count]
    elif mode < 0:
        mode = count - 1
        x[t.turn[owner]] += t.edges[owner, count]
    now.key = with_mode(key, base, count, mode)


@inlined
def with_sectors_at(t, key, x):
    """The key with every sector set to the one that contains x."""
    for s in range(t.sectors.shape[0]):
        at, mode = dot(t.path[s], x), 0
        while mode + 1 < t.sectors[s] and at >= t.edges[s, mode + 1]:
            mode += 1
        key = with_mode(key, sector_weight(t, s), t.sectors[s], mode)
    return key


@inlined
def turns_back(t, mode_set, p, sign, x, T):
    """Whether patch p, about to slip in direction `sign` from w = 0, has a dw/dt that clearly points the other way."""
    rate, size = 0.0, 0.0
    for i in range(x.shape[0]):
        if t.slip[p, i] != 0.0:
            rate += t.slip[p, i] * (dot(t.A[mode_set, i], x) + dot(t.b[mode_set, i], T))
            size += abs(t.slip[p, i]) * (rounding(t.A[mode_set, i], x) + rounding(t.b[mode_set, i], T))
    return sign * rate < -_SLACK / ROUND * size


@inlined
def disagreement(t, mode_set, key, begun, x, size, T, slack):
    """The key that corrects the first mode which the state contradicts; -1 if all modes agree.

    A slipping patch whose w is zero to rounding agrees: it has just been released, or an event of its own will end the
    slip. If it began to slip during this search (`begun` is the key before it), w has to grow. The contacts are checked
    in their order, and again from the first one after every change. Several contacts that change at one instant are a
    complementarity problem; this order is Murty's least-index rule, which does not cycle where other orders do
    (Opsearch 11 (1974) 123). Friction is checked before the normal forces. Reason: where N depends on the acceleration,
    a stuck contact with tensile N is released and then presses. If it were opened first, it would press while open,
    stick again, and the search would never end. A contact that cannot open keeps its mode when N becomes
    tensile, as it does within a block.
    """
    P, K = t.slip.shape[0], t.patch_of_normal.shape[0]
    for p in range(P):
        if not has_closed_contact(t.patch_of_normal, P, key, p):
            continue
        base = patch_weight(p)
        w, noise = dot(t.slip[p], x), rounding(t.slip[p], size)
        mode = mode_in_key(key, base, 3)
        if t.code[mode_set, p] == SMOOTH:  # the law is odd and never sticks: one mode serves both directions
            if mode == SLIP_PLUS:
                continue
            return with_mode(key, base, 3, SLIP_PLUS)
        if mode == STICK:
            if abs(w) > noise or not t.sticks[p]:
                return with_mode(key, base, 3, SLIP_PLUS if w > 0.0 else SLIP_MINUS)
            need = dot(t.friction[mode_set, p], x) + dot(t.friction_t[mode_set, p], T)
            if t.code[mode_set, p] == MEMORY:
                limit = T[p]
            else:
                most = t.static[mode_set, p] if need > 0.0 else t.static_back[mode_set, p]
                limit = most * (dot(t.load[mode_set, p], x) + dot(t.load_t[mode_set, p], T))
            if abs(need) > limit * (1.0 + slack):
                return with_mode(key, base, 3, SLIP_PLUS if need > 0.0 else SLIP_MINUS)
        elif (w if mode == SLIP_PLUS else -w) < -noise:
            return with_mode(key, base, 3, SLIP_PLUS if w > 0.0 else SLIP_MINUS)
        elif abs(w) <= noise and mode_in_key(begun, base, 3) != mode:
            if turns_back(t, mode_set, p, 1.0 if mode == SLIP_PLUS else -1.0, x, T):
                return with_mode(key, base, 3, STICK)
    for k in range(K):
        if not t.opens[k]:
            continue
        N = dot(t.normal[mode_set, k], x) + dot(t.normal_t[mode_set, k], T)
        noise = rounding(t.normal[mode_set, k], size)
        base, p = normal_weight(P, k), t.patch_of_normal[k]
        if mode_in_key(key, base, 2) == 0:
            if N < -noise:
                return with_mode(key, base, 2, 1)
        elif N > noise:
            was_loaded = has_closed_contact(t.patch_of_normal, P, key, p)
            new = with_mode(key, base, 2, 0)
            return new if was_loaded else stick_or_slip(t, new, p, x, size)
    for g in range(t.guards[mode_set]):
        if G_CLOSE < t.kind[mode_set, g] < G_NEXT and dot(t.G[mode_set, g], x) < -rounding(t.G[mode_set, g], x):
            return key_after_event(t.kind[mode_set, g], t.owner[mode_set, g], P, K, key)
    return -1


@by_address
def make_consistent(shape, t, w, state, log, seg, plan, ticks):
    """Make the contact state of `state` consistent with its x; a part (rig.solve.specialised), since it is rare.

    Returns DONE, NEED or JAM.

    A slip speed within the rounding error of the largest values of the states so far (w.size) counts as zero, also
    where belt and body have come to rest. If the same contact has just changed twice in one instant (now.repeat), the
    friction limit of stick is raised by `_SLACK`.
    """
    now, x, size, T, energy = state.progress[0], state.x, w.size, w.T, state.energy
    key, pending = now.key, now.pending
    for i in range(x.shape[0]):
        size[i] = max(size[i], abs(x[i]))
    if pending == START:
        for p in range(t.slip.shape[0]):
            key = stick_or_slip(t, key, p, x, size)
        key = with_switches_thrown(t, with_sectors_at(t, key, x), x)
        pending = PROJECT
    elif with_switches_thrown(t, key, x) != key:
        energy[SWITCH] += network_energy(t.store[t.mode_set_of[key]], x)
        key, pending = with_switches_thrown(t, key, x), THROWN
    slack, begun = _SLACK if now.repeat > 1 else 0.0, now.search_began_at if now.search_began_at >= 0 else key
    for _ in range(4 * (t.slip.shape[0] + t.patch_of_normal.shape[0]) + 12):
        now.key, mode_set = key, t.mode_set_of[key]
        if mode_set < 0:
            now.pending, now.search_began_at = pending, begun
            return NEED
        if pending != CHECK:
            if t.lands[mode_set]:
                project_stick(t, mode_set, x, w.copy)
            if pending == THROWN:
                energy[SWITCH] -= network_energy(t.store[mode_set], x)
            pending = CHECK
        if t.curved[mode_set]:
            copy(x.shape[0], x, w.at)
            call(plan.inputs_of_state, any_shape(x.shape[0]), t, w, state, log, seg, plan, 0)
        else:
            for p in range(T.shape[0]):
                T[p] = 0.0
        new = disagreement(t, mode_set, key, begun, x, size, T, slack)
        if new < 0:
            now.pending, now.search_began_at = READY, -1
            return DONE
        for p in range(t.slip.shape[0]):  # project a patch that has just begun to stick
            if mode_in_key(new, patch_weight(p), 3) == STICK and mode_in_key(key, patch_weight(p), 3) != STICK:
                pending = PROJECT
        key = new
    now.key, now.search_began_at = key, -1
    return JAM
