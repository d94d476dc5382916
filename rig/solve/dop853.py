"""Dormand-Prince 8(5,3): long steps for tight tolerances, with a path of degree seven through each.

A step takes twelve evaluations of the derivative, and three more for the path between its ends. At a tolerance of 1e-10
it is about six times as long as one of dopri5. Events, energy terms and outputs are those of dopri5: its `stretch`
calls `take_long_steps` instead of `take_steps`.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.10, and their code DOP853.
"""

from __future__ import annotations

import numpy as np

from rig.compiled.kernel import by_address, fused, inlined
from rig.compiled.records import lent
from rig.solve.column_blocks import along, copy
from rig.solve.dopri5 import (
    ENDED,
    EVENT_FREE,
    FAILED,
    SAFETY,
    SHARE,
    SHRINK,
    UNDECIDED,
    accept_step,
    free_of_events,
    log_ticks,
    raise_scales,
    set_generators,
)
from rig.solve.forces import right_hand_side
from rig.solve.runge_kutta_stage import begin_stages, complete_derivative, derivative, patch_friction, stage
from rig.solve.specialised import any_shape, call, is_unrolled, local, local_stages, state_count

STAGES = 12
EXTENDED = 16
DEGREE = 7
_GROW = 5.0  # largest factor from a step to the next, as that of dopri5
ERRORS = np.array(
    [
        (
            0.01312004499419488,
            0.0,
            0.0,
            0.0,
            0.0,
            -1.2251564463762044,
            -0.4957589496572502,
            1.6643771824549864,
            -0.35032884874997366,
            0.3341791187130175,
            0.08192320648511571,
            -0.022355307863886294,
        ),
        (
            -0.18980075407240762,
            0.0,
            0.0,
            0.0,
            0.0,
            4.450312892752409,
            1.8915178993145003,
            -5.801203960010585,
            -0.4226823213237919,
            -0.1521609496625161,
            0.20136540080403034,
            0.02265179219836082,
        ),
    ]
)
"""Differences from the weights of the embedded methods of order five and three."""
_D = np.array(
    [
        (
            -8.428938276109013,
            0.0,
            0.0,
            0.0,
            0.0,
            0.5667149535193777,
            -3.0689499459498917,
            2.38466765651207,
            2.117034582445028,
            -0.871391583777973,
            2.2404374302607883,
            0.6315787787694688,
            -0.08899033645133331,
            18.148505520854727,
            -9.194632392478356,
            -4.436036387594894,
        ),
        (
            10.427508642579134,
            0.0,
            0.0,
            0.0,
            0.0,
            242.28349177525817,
            165.20045171727028,
            -374.5467547226902,
            -22.113666853125306,
            7.733432668472264,
            -30.674084731089398,
            -9.332130526430229,
            15.697238121770845,
            -31.139403219565178,
            -9.35292435884448,
            35.81684148639408,
        ),
        (
            19.985053242002433,
            0.0,
            0.0,
            0.0,
            0.0,
            -387.0373087493518,
            -189.17813819516758,
            527.8081592054236,
            -11.57390253995963,
            6.8812326946963,
            -1.0006050966910838,
            0.7777137798053443,
            -2.778205752353508,
            -60.19669523126412,
            84.32040550667716,
            11.99229113618279,
        ),
        (
            -25.69393346270375,
            0.0,
            0.0,
            0.0,
            0.0,
            -154.18974869023643,
            -231.5293791760455,
            357.6391179106141,
            93.40532418362432,
            -37.45832313645163,
            104.0996495089623,
            29.8402934266605,
            -43.53345659001114,
            96.32455395918828,
            -39.17726167561544,
            -149.72683625798564,
        ),
    ]
)


def _rows(*rows):
    """The rows of weights of the earlier stages, padded with zeros."""
    return np.array([(*row, *[0.0] * (EXTENDED - len(row))) for row in rows])


A = _rows(
    (),
    (0.05260015195876773,),
    (0.0197250569845379, 0.0591751709536137),
    (0.02958758547680685, 0.0, 0.08876275643042054),
    (0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792),
    (0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242),
    (0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125),
    (
        0.03709200011850479,
        0.0,
        0.0,
        0.17038392571223998,
        0.10726203044637328,
        -0.015319437748624402,
        0.008273789163814023,
    ),
    (
        0.6241109587160757,
        0.0,
        0.0,
        -3.3608926294469414,
        -0.868219346841726,
        27.59209969944671,
        20.154067550477894,
        -43.48988418106996,
    ),
    (
        0.47766253643826434,
        0.0,
        0.0,
        -2.4881146199716677,
        -0.590290826836843,
        21.230051448181193,
        15.279233632882423,
        -33.28821096898486,
        -0.020331201708508627,
    ),
    (
        -0.9371424300859873,
        0.0,
        0.0,
        5.186372428844064,
        1.0914373489967295,
        -8.149787010746927,
        -18.52006565999696,
        22.739487099350505,
        2.4936055526796523,
        -3.0467644718982196,
    ),
    (
        2.273310147516538,
        0.0,
        0.0,
        -10.53449546673725,
        -2.0008720582248625,
        -17.9589318631188,
        27.94888452941996,
        -2.8589982771350235,
        -8.87285693353063,
        12.360567175794303,
        0.6433927460157636,
    ),
    (
        0.054293734116568765,
        0.0,
        0.0,
        0.0,
        0.0,
        4.450312892752409,
        1.8915178993145003,
        -5.801203960010585,
        0.3111643669578199,
        -0.1521609496625161,
        0.20136540080403034,
        0.04471061572777259,
    ),
    (
        0.056167502283047954,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.25350021021662483,
        -0.2462390374708025,
        -0.12419142326381637,
        0.15329179827876568,
        0.00820105229563469,
        0.007567897660545699,
        -0.008298,
    ),
    (
        0.03183464816350214,
        0.0,
        0.0,
        0.0,
        0.0,
        0.028300909672366776,
        0.053541988307438566,
        -0.05492374857139099,
        0.0,
        0.0,
        -0.00010834732869724932,
        0.0003825710908356584,
        -0.00034046500868740456,
        0.1413124436746325,
    ),
    (
        -0.42889630158379194,
        0.0,
        0.0,
        0.0,
        0.0,
        -4.697621415361164,
        7.683421196062599,
        4.06898981839711,
        0.3567271874552811,
        0.0,
        0.0,
        0.0,
        -0.0013990241651590145,
        2.9475147891527724,
        -9.15095847217987,
    ),
)
"""Weights of each stage; that of number 12 is the end of the step, the last three belong to the path."""


def _path():
    """Coefficients [power - 1, 3 + 4] of the path over the change of the state, the rates at both ends, and _D . k."""
    x = np.polynomial.Polynomial([0.0, 1.0])
    rest = np.eye(7)
    change = [rest[0], rest[1] - rest[0], 2.0 * rest[0] - rest[1] - rest[2], *rest[3:]]
    out = np.zeros((DEGREE + 1, 7))
    for i, term in enumerate(change):
        weight = np.polynomial.Polynomial([1.0])
        for factor in range(i + 1):
            weight = weight * (x if factor % 2 == 0 else 1.0 - x)
        out[: len(weight.coef)] += np.outer(weight.coef, term)
    return out[1:]


PATH = _path()


@inlined
def weighted_sum(shape, weights, k, count, out):
    """Write the sum of the first `count` derivatives k times `weights`, in their order, to `out`."""
    if is_unrolled(shape):
        for i in range(state_count(shape)):
            out[i] = 0.0
        for j in range(count):
            if weights[j] != 0.0:
                for i in range(state_count(shape)):
                    out[i] += weights[j] * k[j, i]
    else:  # rows padded to whole lanes
        along(k[:count], weights, out)


@fused
def stages_from(shape, f, friction, first, last, late, k, x, h, z):
    """Compute the derivatives number `first` to `last` of a step h from x, the last of them at z."""
    n = state_count(shape)
    for s in range(first, last + 1):
        weighted_sum(shape, A[s], k, s - 1, z)
        for i in range(n):
            z[i] = x[i] + h * z[i]
        late = stage(shape, f, friction, h * A[s, s - 1], z, k, s - 1, late)
    complete_derivative(shape, f, friction, k, last, late)


@inlined
def long_error(shape, k, y, size, h, tolerance, a, b):
    """The local error in units of the tolerance, as in rig.solve.dopri5.local_error; a and b are scratch."""
    n, fifth, third = state_count(shape), 0.0, 0.0
    weighted_sum(shape, ERRORS[0], k, STAGES, a)
    weighted_sum(shape, ERRORS[1], k, STAGES, b)
    for i in range(n):
        if not (abs(a[i]) + abs(b[i]) + abs(y[i]) < np.inf):
            return np.inf
        largest = max(size[i], abs(y[i]))
        if largest > 0.0:
            scale = h / (SHARE * tolerance * largest)
            fifth, third = max(fifth, abs(a[i]) * scale), max(third, abs(b[i]) * scale)
    if fifth == 0.0:
        return 0.0
    return fifth * fifth / np.sqrt(fifth * fifth + 0.01 * third * third)


@inlined
def write_path(shape, k, x, y, h, bends, d):
    """Write the coefficients d[0..7] of the path through the step; bends[0..3] is scratch."""
    for p in range(4):
        weighted_sum(shape, _D[p], k, EXTENDED, bends[p])
    for i in range(state_count(shape)):
        change, begin, end = y[i] - x[i], h * k[0, i], h * k[STAGES, i]
        a, b, c, e = h * bends[0, i], h * bends[1, i], h * bends[2, i], h * bends[3, i]
        d[0, i] = x[i]
        for p in range(DEGREE):
            d[p + 1, i] = ((PATH[p, 0] * change + PATH[p, 1] * begin) + (PATH[p, 2] * end + PATH[p, 3] * a)) + (
                (PATH[p, 4] * b + PATH[p, 5] * c) + PATH[p, 6] * e
            )


@by_address
def take_long_steps(shape, t, w, state, log, seg, plan, ticks):
    """Take steps from state.x to the end of the ticks, or to a step that `stretch` must handle.

    As rig.solve.dopri5.take_steps, with the same results, of w.k only the derivatives at both ends: numbers 0 and 6.
    """
    n, tick_length, mode_set = state_count(shape), t.step[0], t.mode_set_of[state.progress[0].key]
    now, x, size = state.progress[0], state.x, w.size
    graded = t.graded[mode_set] > 0
    looked = plan.with_energy or plan.emitting or graded
    field = right_hand_side(t, mode_set, w.T, w.scratch)
    f, friction = lent(field), lent(patch_friction(shape, field, True, t, w, state, log, seg, plan))
    k, y, z, d = local_stages(shape, w.k16), local(shape, w.y), local(shape, w.y2), local(shape, w.derivatives)
    here, bends = local(shape, w.copy), local(shape, w.bends)
    tick, place, next_h, hoped, most = now.tick, now.place, now.next_length, now.suggested_length, now.trial_limit
    copy(n, x, here)
    copy(n, w.k[0], k[0])
    if hoped == 0.0:
        derivative(shape, f, True, here, k[0], t, w, state, log, seg, plan)
        copy(n, k[0], w.k[0])
        raise_scales(x, w.k[0], t.damping.shape[1], min(tick_length, next_h) if graded else tick_length, size)
    ends, refused = ENDED, False
    while tick < ticks:
        left = ((ticks - tick) - place) * tick_length
        h = next_h if next_h < left - 1e-9 * tick_length else left
        stages_from(shape, f, friction, 1, STAGES, begin_stages(shape, friction, k, 0), k, here, h, y)
        e = long_error(shape, k, y, size, h, plan.tolerance, bends[0], bends[1])
        now.trials += 1
        if not (e <= 1.0):
            next_h, again = h * max(SHRINK, SAFETY * e ** (-0.125)), refused
            refused = True
            if next_h < 1e-14 * tick_length or now.trials > most:
                ends = FAILED
                break
            if again:
                copy(n, here, x)
                now.next_length = next_h
                call(plan.raise_to_rounding, any_shape(n), t, w, state, log, seg, plan, 0)
            continue
        grow = min(_GROW, SAFETY * max(e, 1e-8) ** (-0.125))
        if h >= next_h or grow < 1.0:
            next_h = h * (min(grow, 1.0) if refused else grow)
        refused = False
        hoped = h * grow
        stages_from(shape, f, friction, 13, 15, begin_stages(shape, friction, k, STAGES), k, here, h, z)
        write_path(shape, k, here, y, h, bends, d)
        plain = free_of_events(shape, f, d, DEGREE, size)
        if looked or not plain:
            now.step_length = h
            copy(n, y, w.y)
            copy(n, k[STAGES], w.k[6])
            for c in range(DEGREE + 1):
                copy(n, d[c], w.derivatives[c])
            ends = EVENT_FREE if plain else UNDECIDED
            break
        tick, place, done = log_ticks(shape, log, d, DEGREE, mode_set, tick, place, ticks, tick_length / h, h == left)
        if done < 1.0:
            place += (1.0 - done) * h / tick_length
        set_generators(shape, t, w, ((tick - now.reached) + place) * tick_length, y)
        accept_step(shape, t, mode_set, w, y, x, here)
        copy(n, k[STAGES], k[0])
    now.tick, now.place, now.next_length, now.suggested_length = tick, place, next_h, hoped
    copy(n, here, x)
    copy(n, k[0], w.k[0])
    return ends
