"""Growth rate of a tone that rises out of noise, with its interval of 90 %.

The tone is mixed down to a complex amplitude z, whose samples have independent noise of known power. The model of z,
from the noise before the growth to the time after it, is a corner:

    ln z = c + (a + i w) u - (a - d + i k) s(u)      s(u) = ln(1 + exp(p a u)) / (p a),  u = t - t0

a [1/s] is the growth, d [1/s] the slope that follows, w and w - k [rad/s] the frequencies of both, p the sharpness of
the corner: 2 is that of a Hopf bifurcation (Landau), a large one that of a sudden limit. The end of the growth is part
of the fit, and so is its uncertainty. The growth is the median of its posterior distribution, drawn by importance
sampling; its interval holds 90 % of it. Beforehand, sudden corners count as four times as likely as smooth ones.

If the corner does not describe the samples to the noise, an exponential is fitted before it. Of many spans the one with
the smallest deviation is taken, in which the difference to the next shorter spans counts.

Source: Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, section 15.8; adaptive importance
sampling, Cappe, Guillin, Marin, Robert, J. Comp. Graph. Stat. 13 (2004) 907; differences of spans, Hausman,
Econometrica 46 (1978) 1251.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.record.run import Reals

Complex = NDArray[np.complex128]
_REACH = 8  # samples of z in half of the filter
_FIRST = 16.0  # half of the first band [1 / duration of the event]
_BAND = 4.0  # half of the last band [growth / s]
_CLEAR = 60.0  # power over the noise above which a wider band shows a faster growth
_TAILS = (3.0, 1.0)  # ends of the fits of the corner after it [1/a]
_STARTS = (99.0, 4.0, 2.5, 1.7)  # of an exponential before the corner [1/a before it]; 99: from the noise on
_ENDS = (-0.2, -0.5, -1.0, -1.5, -2.2, -3.0)  # of an exponential before the corner [1/a]
_LOW = (-2.5, -6.0, -60.0, -5.0, -60.0, 0.02)  # bounds of the values
_HIGH = (2.5, 6.0, 60.0, 0.15, 60.0, 0.6)
_SCALE = (0.1, 0.2, 0.2, 0.1, 0.2, 0.2)  # their usual size, by which steps of the fit are scaled
# What is known beforehand
_CORNERS = ((4.0, 0.02, 0.03), (1.0, 0.5, 0.06))  # corners are sudden or smooth (share, 1/p, width)
_OTHER = 0.02  # or something between
_SHORT = 0.8  # growth a before 1/a


class Growth(NamedTuple):
    """Growth `rate` [1/s], its interval `low` to `high`, end of the growth `knee` [s], offset of the frequency [Hz]."""

    rate: float
    low: float
    high: float
    knee: float
    offset: float


class _Grown(NamedTuple):
    """A growth, the residuals beyond what noise explains, and the deviation of ln a."""

    growth: Growth
    excess: float
    deviation: float


class _Fit(NamedTuple):
    """A fit `p` with its covariance, the end of the growth [s], the residuals over the noise (`scale` of the power, and
    `excess` beyond what noise explains), and the deviation of ln a.
    """

    corner: _Corner
    p: Reals
    covariance: Reals
    knee: float
    scale: float
    excess: float
    deviation: float


def mixed(v: Reals, rate: float, f: float, half: float) -> tuple[Complex, float, float]:
    """Complex amplitude of the tone `f` within +-`half` [Hz], missing where `v` is; step [s]; power of a noise of 1/Hz.

    The filter is half of a raised cosine: the noise of different samples is independent.
    """
    from scipy.signal import upfirdn

    every = max(int(rate / (2.0 * half)), 1)
    reach = _REACH * every
    g = np.fft.fftfreq(2 * reach + 1) * every  # of the rate of z
    edge = np.clip((np.abs(g) - 0.25) / 0.5, 0.0, 1.0)
    shape = np.sqrt(0.5 + 0.5 * np.cos(math.pi * edge))
    taps = np.fft.fftshift(np.fft.ifft(shape).real)
    known = np.isfinite(v)
    turned = 2.0 * np.where(known, v, 0.0) * np.exp(-2j * np.pi * f / rate * np.arange(v.size))
    z = upfirdn(taps, turned, 1, every)[_REACH:][: -(-v.size // every)]
    missing = np.pad(~known, 2 * every, constant_values=True)
    count = np.concatenate(([0], np.cumsum(missing)))
    incomplete = count[4 * every + 1 :] > count[: -4 * every - 1]
    z[incomplete[::every]] = np.nan
    return z, every / rate, 2.0 * rate * float(taps @ taps)


def grown(v: Reals, rate: float, f: float, density: float, begin: float, end: float, half: float) -> Growth | None:
    """Return the growth of the tone `f` [Hz] in the samples `v`, heard from `begin` to `end` [s], or None.

    `density`: of the noise beside the tone [1/Hz]; `half`: distance [Hz] of the next tone.
    """
    best = _grown(v, rate, f, density, begin, end, half)
    if best is None or best.excess > 0.0:  # it may begin with a knock, and grow then
        first = max(round(begin * rate), 0)
        later = _grown(v[first:], rate, f, density, 0.0, end - begin, half)
        if later is not None and (best is None or (later.excess > 0.0, later.deviation) < (True, best.deviation)):
            return later.growth._replace(knee=later.growth.knee + first / rate)
    return best.growth if best else None


def _grown(v: Reals, rate: float, f: float, density: float, begin: float, end: float, half: float) -> _Grown | None:
    """The growth from the begin of `v` on."""
    width = min(half, max(_FIRST / max(end - begin, 1e-9), 0.01 * f))
    for _ in range(12):  # the band follows the growth
        z, step, power = mixed(v, rate, f, width)
        noise = density * power
        rough = _rough(np.abs(z) ** 2, step, noise, begin, end)
        if rough is None:
            return None
        a, knee, level = rough
        if a < 0.5 / step or level < _CLEAR * noise or width >= half:
            break
        width = min(2.0 * width, half)
    z, step, power = mixed(v, rate, f, min(_BAND * a, half))
    fitted = _fitted(z, step, density * power, a, knee, level)
    if fitted is None:
        return None
    sudden = fitted.growth.rate * step > 1.0 or abs(fitted.growth.offset) > 0.5 / step
    return None if sudden else fitted  # within a sample of z nothing is known of it


def _rough(size: Reals, step: float, noise: float, begin: float, end: float) -> tuple[float, float, float] | None:
    """Growth [1/s], its end [s] and power of the tone there, from the power alone, which needs no phase."""
    t = np.arange(size.size) * step
    known = np.nan_to_num(size, nan=noise)
    count = max(min(round((end - begin) / step / 8), 9), 1)
    smooth = np.convolve(known, np.ones(count) / count, "same")
    inside = (t >= begin - step) & (t <= end + step)
    if inside.sum() < 3:
        return None
    top = float(smooth[inside].max())
    if not top > 2.0 * noise:
        return None
    first = int(np.argmax(inside & (smooth >= 0.4 * top)))
    quiet = np.flatnonzero(smooth[: first + 1] <= max(2.0 * noise, 1e-4 * top))
    if not quiet.size and np.nanmin(smooth[: first + 1]) > 0.2 * top:
        return None  # it has grown before
    begin_of_rise = t[quiet[-1]] if quiet.size else 0.0
    rise = max(t[first] - begin_of_rise, step)
    tail = max(rise, 0.15 * (end - begin))
    for _ in range(4):
        used = np.isfinite(size) & (t <= min(t[first] + tail, end) + step)
        if used.sum() < 4:
            return None
        times = t[used]
        a, at, level = _powers(times, step, size[used], noise, t[first], rise, top)
        if at + 1.0 / a <= times[-1] + step or t[first] + tail >= end:
            break
        tail *= 2.0
    return (a, at, level) if times[0] - step <= at <= times[-1] + step else None


def _powers(
    t: Reals, step: float, size: Reals, noise: float, first: float, rise: float, top: float
) -> tuple[float, float, float]:
    """Growth, its end and the power there that are most likely for the powers `size` of exponential distributions."""
    from scipy.optimize import minimize

    def cost(p: Reals) -> float:
        a = math.exp(p[0])
        _, at, level, slope = p
        if not 1e-6 < a * step < 1.3:
            return math.inf
        u = t - at
        logarithm = level + 2.0 * np.where(u < 0.0, a * u, slope * u)
        mean: Reals = noise + np.exp(np.clip(logarithm, -700.0, 700.0))
        unusual: float = (slope / (0.2 * a)) ** 2
        return float(np.sum(np.log(mean) + size / mean)) + unusual

    steps = 0.5 * math.log(max(top / noise, 4.0)) / rise * np.geomspace(0.25, 4.0, 9)
    steps = np.unique(np.minimum(steps, 1.0 / step))
    ends = first + rise * np.linspace(-0.75, 0.75, 7)
    starts = [np.array([math.log(a), at, math.log(top), 0.0]) for a in steps for at in ends]
    options = {"maxiter": 400, "xatol": 1e-3, "fatol": 1e-3}
    best: Reals = minimize(cost, min(starts, key=cost), method="Nelder-Mead", options=options).x
    return math.exp(float(best[0])), float(best[1]), math.exp(min(float(best[2]), 700.0))


def _fitted(z: Complex, step: float, noise: float, a: float, knee: float, level: float) -> _Grown | None:
    """The fit of the corner to the amplitude z, or of an exponential before it."""
    lead = 0.5 * math.log(max(level / noise, 1.0)) + 3.0
    fits = list[_Fit]()
    for tail in _TAILS:
        fit = _fit(z, step, noise, a, knee, (-lead, tail), plain=False)
        if fit is not None and fit.excess <= 0.0:
            best = fit
            break
        fits += [fit] if fit is not None else []
    else:
        exponentials = list[_Fit]()
        knees = {knee, *(fit.knee for fit in fits)}
        for at in sorted(knees):
            exponentials += _steadier(_exponentials(z, step, noise, a, at, lead))
        if not (exponentials or fits):
            return None
        best = min(exponentials or fits, key=lambda fit: fit.deviation)
    values, weights = best.corner.drawn(best.p, best.covariance, best.scale)
    order = np.argsort(values[:, 0])
    quantiles = np.interp((0.05, 0.5, 0.95), np.cumsum(weights[order]), values[order, 0])
    low, rate, high = np.exp(quantiles) * a
    turn = float(weights @ values[:, 2]) * a / (2.0 * math.pi)
    return _Grown(Growth(float(rate), float(low), float(high), best.knee, turn), best.excess, best.deviation)


def _exponentials(z: Complex, step: float, noise: float, a: float, knee: float, lead: float) -> list[list[_Fit | None]]:
    """The exponentials fitted to spans before the knee, by start and end; none begins before the `lead` [1/a]."""
    rows = []
    for start in _STARTS:
        begin = -min(lead, start)
        rows.append([_fit(z, step, noise, a, knee, (begin, end), plain=True) for end in _ENDS])
    return rows


def _steadier(fits: list[list[_Fit | None]]) -> Iterator[_Fit]:
    """The fits [start, end] that have shorter neighbours, their deviations raised by what differs beyond the noise."""
    for i, row in enumerate(fits[:-1]):
        for k, fit in enumerate(row[:-1]):
            shorter = [other for other in (row[k + 1], fits[i + 1][k]) if other is not None]
            if fit is None or not shorter:
                continue
            square = fit.deviation**2
            drift = max((fit.p[0] - other.p[0]) ** 2 - abs(other.deviation**2 - square) for other in shorter)
            deviation = math.sqrt(square + max(drift, 0.0))
            yield fit._replace(scale=fit.scale * (deviation / fit.deviation) ** 2, deviation=deviation)


def _fit(
    z: Complex, step: float, noise: float, a: float, knee: float, span: tuple[float, float], plain: bool
) -> _Fit | None:
    """The fit to the samples in a `span` [1/a] around the knee; None if they are too few."""
    x = np.asarray((step * np.arange(z.size) - knee) * a, np.float64)
    inside = (x >= span[0]) & (x <= span[1]) & np.isfinite(z)
    corner = _Corner(x[inside], z[inside] * math.sqrt(2.0 / noise), plain)
    dof = 2 * int(inside.sum()) - len(corner.free) - 2
    if dof < 4:
        return None
    guesses = (1.0,) if plain else (1.0, 0.6, 1.7)
    p, cost, covariance = min((corner.fit(guess) for guess in guesses), key=lambda fit: fit[1])
    scale = max(cost / dof, 1.0)
    excess = cost - dof - 3.0 * math.sqrt(2.0 * dof)
    if excess > 0.0:  # neighbours depend on each other where the model does not fit: there is less to learn from them
        scale *= corner.dependence(p)
    at = knee if plain else knee + float(p[1]) / a
    return _Fit(corner, p, covariance, at, scale, excess, math.sqrt(scale * float(covariance[0, 0])))


class _Corner:
    """The model beside the samples `part`, scaled to a noise of deviation 1 in both parts, at the times `x` [1/a].

    Values [..., 6]: ln a, t0, w, d/a, k, 1/p; `plain`: an exponential, a and w only.
    """

    def __init__(self, x: Reals, part: Complex, plain: bool) -> None:
        self.x = x
        self.part = part
        self.plain = plain
        self.free: list[int] = [0, 2] if plain else [0, 1, 2, 3, 4, 5]

    def shape(self, p: Reals) -> Complex:
        """The amplitudes [..., x], up to a factor."""
        rate, at, turn, slope, shift, soft = (p[..., i, None] for i in range(6))
        rate = np.exp(rate)
        if self.plain:
            return np.asarray(np.exp((rate + 1j * turn) * (self.x - self.x[-1])))
        u = self.x - at
        bend = np.logaddexp(0.0, rate * u / soft) * soft / rate
        grows = (rate + 1j * turn) * u - (rate - slope * rate + 1j * shift) * bend
        return np.asarray(np.exp(grows - grows.real.max(axis=-1, keepdims=True)))

    def residuals(self, p: Reals) -> Reals:
        """The residuals [n], the factor fitted; last those of the usual values of d, k and t0."""
        m = self.shape(p)
        factor = np.vdot(m, self.part) / np.vdot(m, m).real
        r = self.part - factor * m
        usual = [] if self.plain else [_cauchy(p[3] / 0.1), _cauchy(p[4] / 0.3), p[1] / 3.0]
        return np.concatenate([r.real, r.imag, usual])

    def dependence(self, p: Reals) -> float:
        """How many samples count as one, because the residuals of neighbours are alike; at least 1."""
        r = self.residuals(p)[: 2 * self.x.size]
        r = r[: self.x.size] + 1j * r[self.x.size :]
        lags = np.arange(1, max(r.size // 4, 1) + 1)
        products = np.array([float(np.vdot(r[lag:], r[:-lag]).real) for lag in lags])
        alike = products / float(np.vdot(r, r).real)
        weights = 1.0 - lags / (lags.size + 1)
        return max(1.0 + 2.0 * float(weights @ alike), 1.0)

    def costs(self, p: Reals) -> Reals:
        """The sum of the squares of the residuals of many p [i, 6]; infinite outside of the bounds."""
        m = self.shape(p)
        along = np.abs(m.conj() @ self.part) ** 2 / np.sum(np.abs(m) ** 2, axis=-1)
        cost = np.sum(np.abs(self.part) ** 2) - along
        if not self.plain:
            log_a, at, _, slope, shift, soft = p.T
            cost += _cauchy(slope / 0.1) ** 2 + _cauchy(shift / 0.3) ** 2 + at**2 / 9.0
            corners = (share * np.exp(-0.5 * ((soft - middle) / width) ** 2) for share, middle, width in _CORNERS)
            cost += _SHORT * log_a - 2.0 * np.log(_OTHER + sum(corners))
        outside = ((p < _LOW) | (p > _HIGH))[:, self.free].any(axis=1)
        return np.where(outside, math.inf, cost)

    def fit(self, guess: float) -> tuple[Reals, float, Reals]:
        """The best values from a guess of the growth, their cost and covariance."""
        from scipy.optimize import least_squares

        p = np.array([math.log(guess), 0.0, 0.0, 0.0, 0.0, 0.3])
        p[2] = self._turn(self.shape(p))
        low, high, scale = (np.array(bound)[self.free] for bound in (_LOW, _HIGH, _SCALE))

        def residuals(q: Reals) -> Reals:
            p[self.free] = q
            return self.residuals(p)

        fit = least_squares(residuals, p[self.free], bounds=(low, high), x_scale=scale, max_nfev=80)
        p[self.free] = fit.x
        J = fit.jac * scale
        information = J.T @ J + 0.1 * np.eye(scale.size)
        covariance = np.linalg.inv(information) * np.outer(scale, scale)
        return p, 2.0 * float(fit.cost), covariance

    def _turn(self, m: Complex) -> float:
        """The frequency that fits best with the amplitudes m."""
        gap = float(np.median(np.diff(self.x)))
        places = np.rint((self.x - self.x[0]) / gap).astype(int)
        even = np.zeros(round(float(self.x[-1] - self.x[0]) / gap) + 1, complex)
        even[places] = self.part * m.conj()
        count = 1 << (4 * even.size - 1).bit_length()
        at = int(np.argmax(np.abs(np.fft.fft(even, count))))
        return 2.0 * math.pi * float(np.fft.fftfreq(count)[at]) / gap

    def drawn(self, p: Reals, covariance: Reals, scale: float) -> tuple[Reals, Reals]:
        """Values [i, 6] and weights [i] of the posterior: importance sampling from distributions that adapt to it."""
        rng = np.random.default_rng(1)
        middle = p[self.free]
        spread = covariance * scale
        for count in (1000, 1000, 1000, 4000):
            normal = rng.multivariate_normal(np.zeros(middle.size), 1.5 * spread, count, method="eigh")
            normal *= np.sqrt(5.0 / rng.chisquare(5.0, count))[:, None]
            drawn = np.repeat(p[None], count, axis=0)
            drawn[:, self.free] = middle + normal
            far = np.einsum("ij,jk,ik->i", normal, np.linalg.pinv(1.5 * spread), normal)
            log_weight = -0.5 * self.costs(drawn) / scale + 0.5 * (5.0 + middle.size) * np.log1p(far / 5.0)
            weight = np.exp(log_weight - log_weight.max())
            weight /= weight.sum()
            middle = weight @ drawn[:, self.free]
            away = drawn[:, self.free] - middle
            spread = (weight * away.T) @ away + 1e-4 * covariance
        return drawn, weight


def _cauchy(x: Any) -> Any:
    """A residual whose square is that of a Cauchy distribution."""
    return np.sign(x) * np.sqrt(2.0 * np.log1p(0.5 * x * x))
