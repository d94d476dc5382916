"""The report of `rig loop`: delay budget, margins, and decay over delay, jitter and loss with one point simulated.

The delay budget of a control loop: what delays it at the frequency of its least stable mode, and who states that.

A filter delays by phase / frequency; a lag of first order by atan(w T) / w; a value held over a period by half of it.

The decay of a loop at small motions, read off an ensemble of simulations with the links of a scene.

Each run begins at steady sliding, moved along the least stable mode of the closed loop by a thousandth of the rig's own
deflection, and has a network seed of its own; sensors have neither noise nor limits. The mean square of the output that
the sensor reads, over all runs and over each period of the vibration, is fitted by an exponential: its rate is twice
the growth rate of the mean square.

A control loop over impaired links as a jump linear system: growth of the mean and of the mean square.

At every tick a link delivers a message of some age, or none, and then the last one is held. The loop z(k+1) = A_j z(k)
has a matrix for each case j, which occurs with probability p_j. For cases that are independent from tick to tick

    mean          E z(k+1) = (sum_j p_j A_j) E z(k)
    mean square   S(k+1) = sum_j p_j A_j S(k) A_j^T,    S = E z z^T

and the loop is stable in the mean square exactly if the spectral radius of the second map is below one (Costa, Fragoso,
Marques (2005), "Discrete-Time Markov Jump Linear Systems", theorem 3.9 with independent cases). Growth rates are
ln(radius) / T and ln(radius) / (2 T). Decay in the mean square implies decay of almost every single run.

Loss with a constant delay is exactly of this kind. With jitter the age of successive messages is not independent; the
model draws it from its stationary distribution at each tick, as Nilsson (1998), "Real-Time Control Systems with
Delays", does for random delays. Duplicates are left out: without reordering a second copy brings nothing new.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig import design
from rig.analysis.control_loop import Loop, ends, loop, plant
from rig.bench.run.experiment import Experiment
from rig.bench.run.simulate import begun, carry_on
from rig.controllers import restored
from rig.errors import NumericsError, SceneError
from rig.printable import columns, counted
from rig.results import Result
from rig.scenes.explain import explain
from rig.scenes.network import Link, Network, described
from rig.scenes.scene import Scene
from rig.scenes.sections import dump
from rig.sensors.chain.front_end import FrontEnd

_ROUNDED = 1e-12  # rad
Array = NDArray[np.float64]
RUNS = 8
"""Runs of an ensemble. # chosen"""
_SHARE = 1e-3
_DECADES = 8.0  # change of ln(amplitude) that a run should reach, and the least number of periods that it has. [chosen]
_PERIODS = (12, 400)
POINTS = 9
"""Values of each curve. # chosen"""
_MOST_LOSS = 0.9
_FREE = 20  # frames of delay that the curve covers if the loop has no delay margin. [chosen]


@dataclass(frozen=True)
class Item:
    """One delay of a loop [s], and its `origin`: a key of the scene with its origin, computed, or measured."""

    part: str
    seconds: float
    origin: str


def links(scene: Scene, name: str) -> tuple[Link, Link]:
    """The links of the loop of controller `name`: of its sensor, and of its commands."""
    network = scene.network
    return network.meas.get(ends(scene, name)[0], Link()), network.act.get(name, Link())


def budget(scene: Scene, closed: Loop, bus: float | None = None) -> Iterator[Item]:
    """The delays of the loop `closed` of `scene` in the order of the signal.

    `bus`: measured time [s] from a step to its answer over the bus; None: it was not measured.
    """
    name = closed.controller
    section, omega = scene.controllers[name], abs(closed.spectrum.rates[0].imag)
    (sensor, drive), (meas, act), frame = ends(scene, name), links(scene, name), scene.frame_ns
    origins = {value.key: f"{value.key} ({value.origin.origin})" for value in explain(scene).values}
    end = scene.sensors[sensor].front_end()

    def of_link(side: str, part: str, link: Link) -> Item:
        known = part in getattr(scene.network, side)
        origin = f"network.{side}.{part}: mean age of what arrives" if known else "a perfect link"
        return Item(f"link {side}/{part}", mean_age(link, frame) * frame * 1e-9, origin)

    if omega:
        late = 1e-9 * end.delay_ns
        turn = -cmath.phase(end.response(1j * omega) / end.response(1e-9j * omega) * cmath.exp(1j * omega * late))
        turn = turn if abs(turn) > _ROUNDED else 0.0
        yield Item(f"filter of {sensor}", turn / omega, "computed from its transfer function")
    yield Item(f"delay of {sensor}", 1e-9 * end.delay_ns, origins.get(f"sensors.{sensor}.delay", "its instrument"))
    yield of_link("meas", sensor, meas)
    yield Item(f"computation of {name}", 1e-9 * section.delay, origins.get(f"controllers.{name}.delay", "default"))
    yield of_link("act", name, act)
    yield Item("sample and hold", 0.5 * closed.model.period, "half a period, computed")
    key = f"{drive.partition('.')[0]}.lag"
    lag: Any = scene.values().get(key, (0.0, ""))[0]
    if scene.assemble().inputs[drive].lagging and isinstance(lag, float | int) and lag:
        yield Item(f"lag of {drive}", math.atan(omega * lag) / omega if omega else lag, origins.get(key, key))
    else:
        yield Item(f"lag of {drive}", 0.0, "none in the scene")
    if section.where == "process":
        origin = "rig run --pace: not measured (--measure does)" if bus is None else f"{1e3 * bus:.2g} ms, measured"
        frames = 1 if bus is None else max(math.ceil(bus * 1e9 / frame), 1)
        yield Item("bus of a paced run", frames * frame * 1e-9, f"{origin}: {counted(frames, 'frame')}")


@dataclass(frozen=True)
class Checked:
    """Growth rate of the mean square [1/s] in `runs` simulations of `seconds` each."""

    growth: float
    runs: int
    seconds: float


def simulated(scene: Scene, name: str, network: Network, expected: float, of: Growth) -> Checked:
    """Simulate the loop of controller `name` over the links of `network`, from the shape that grows as computed.

    `expected`: computed growth rate [1/s]; it and the frequency decide on the length of the runs. Raises SceneError if
    the vibration is not small (a contact sticks or opens) or the integration stops.
    """
    hertz = of.hertz
    section = scene.controllers[name]
    if "enable_at" in type(section).model_fields:
        section = section.model_copy(update={"enable_at": 0})
    sensors: dict[str, Any] = {key: _Linear(sensor) for key, sensor in scene.sensors.items()}
    described = design.described(replace(scene, controllers={name: section}))[name]  # with the noise of its sensor
    alone = replace(scene, controllers={name: section}, sensors=sensors, believed={}, protocol=(), faults={}, limits={})
    long = min(max(_DECADES / max(abs(expected), 1e-9), _PERIODS[0] / hertz), _PERIODS[1] / hertz)
    if expected > 0.0:
        long = min(long, 3.0 / expected)
    output = scene.sensors[ends(scene, name)[0]].reads
    seeded = (replace(alone, network=network.model_copy(update={"seed": seed})) for seed in range(1, RUNS + 1))
    runs = np.array([_run(scene, name, described, output, long, of.shape) for scene in seeded])
    steps = 1e9 / hertz / alone.step_ns
    ends_of = np.rint(np.arange(int(runs.shape[1] / steps) + 1) * steps).astype(int)  # of periods
    square = np.array([runs[:, a:b].var(axis=1).mean() for a, b in pairwise(ends_of.tolist())])
    kept = square > 1e-20 * square.max()
    bins = np.flatnonzero(kept)[1:]  # after the first period: the links are still empty at the beginning
    if len(bins) < 3:
        raise SceneError(scene.name, [f"the vibration has too few periods of {1 / hertz:.3g} s to fit a decay"])
    rate = float(np.polyfit(bins / hertz, np.log(square[bins]), 1)[0])
    return Checked(0.5 * rate, RUNS, long)


class _Linear:
    """An instrument without noise, resolution and limits: only its linear response, so that small motions are seen."""

    def __init__(self, instrument: Any) -> None:
        self._instrument = instrument

    def __getattr__(self, name: str) -> Any:
        return getattr(self._instrument, name)

    def front_end(self) -> FrontEnd:
        """Its front end."""
        end: FrontEnd = self._instrument.front_end()
        unlimited = replace(end, low=-math.inf, high=math.inf, slew=math.inf)
        return replace(unlimited, offset=0.0, slope=0.0, warmth=0.0, noise=0.0, resolution=0.0, dropout_rate=0.0)


def _run(scene: Scene, name: str, described: dict[str, Any], output: str, seconds: float, shape: Array) -> Array:
    """The values of `output` at every sample step, from a small motion along `shape`.

    `described`: the description of controller `name`.
    """
    at = plant(scene)
    # by displacements: a fast mode has much larger velocities
    places = [i for i, state in enumerate(at.states) if not state.endswith("'")]
    shape = shape * _SHARE * (np.abs(at.equilibrium[places]).max() or 1e-3) / np.abs(shape[places]).max()

    def move(experiment: Experiment) -> None:
        motion = experiment.runner.motion
        for state, value in zip(at.states, at.equilibrium + shape):
            motion.write(motion.system.names.index(state), float(value))

    ticks = round(seconds * 1e9) // scene.frame_ns
    experiment, working = begun(scene, {name: restored(described)}, ticks * scene.frame_ns, before=move)
    runner = experiment.runner
    try:
        while experiment.begin():
            carry_on(experiment, working, experiment.until())
    except NumericsError as fault:
        raise SceneError(scene.name, [f"the simulation stopped: {fault.what}"]) from None
    if runner.statistics()["events"]:
        raise SceneError(scene.name, ["a contact sticks or opens even at a small vibration: its decay is not defined"])
    assert runner.truth is not None
    runner.hand_over(runner.truth)
    values, _ = runner.truth.outputs()
    return np.asarray(values[runner.outputs.index(output)])


@dataclass(frozen=True)
class Curve:
    """Growth rates [1/s] over one property of the link of the sensor: `values` in seconds, or a probability."""

    key: str
    values: Sequence[float]
    growth: Sequence[float]


@dataclass
class LoopReport(Result):
    """What delays a loop, what it can still bear, and how its decay depends on the links.

    `found`: the loop with the mean age of its links as a constant delay. `point`: links of the simulated point.
    """

    FIGURE: ClassVar = "rig.analysis.figures:loop_report_figure"

    scene: str
    found: Loop
    items: list[Item]
    growth: float
    curves: list[Curve]
    point: str
    computed: float
    checked: Checked | None = None
    of_mean: bool = False
    """Whether `computed` is the rate of the mean, because that of the mean square, which runs show, was not found."""
    notes: list[str] = field(default_factory=list)

    @property
    def error(self) -> float | None:
        """Relative error of the computed growth rate against the simulated one; None if they cannot be compared."""
        if self.checked is None or self.of_mean:
            return None
        return abs(self.computed - self.checked.growth) / abs(self.checked.growth)

    def to_json(self) -> dict[str, Any]:
        """The report as JSON values."""
        return {
            "scene": self.scene,
            "controller": self.found.controller,
            "budget": [asdict(record) for record in self.items],
            "growth": self.growth,
            "loop": self.found.to_json(),
            "curves": [asdict(record) for record in self.curves],
            "check": {
                "links": self.point,
                "computed": self.computed,
                "simulated": None if self.checked is None else asdict(self.checked),
                "relative_error": self.error,
            },
            "notes": self.notes,
        }

    def text(self) -> str:
        """The report as text."""
        hertz = abs(self.found.spectrum.rates[0].imag) / (2.0 * math.pi)
        total = sum(item.seconds for item in self.items)
        rows = [("delay budget", f"ms at {hertz:.4g} Hz", "deg", "origin")]
        rows += [(o.part, f"{1e3 * o.seconds:.4g}", f"{360 * o.seconds * hertz:.3g}", o.origin) for o in self.items]
        rows += [("sum", f"{1e3 * total:.4g}", f"{360 * total * hertz:.3g}", "")]
        lines = [f"{self.scene}: loop of {self.found.controller} ({self.found.through})"]
        told = (self.found.left_out, *self.found.belief)
        lines += [*(f"  {line}" for line in told if line), "", *columns(rows, "<>><")]
        return "\n".join([*lines, "", *self._margins(), "", *self._curves(), "", *self._check()])

    def _margins(self) -> Iterator[str]:
        yield f"  decay rate at steady sliding {-self.growth:.6g} 1/s, with its links in the mean square"
        yield from self.found.margin_lines("ms more than the budget without the bus")
        if (ends := self.found.gain_range) is not None and self.found.gain:
            least, most = sorted(end / self.found.gain for end in ends)
            low = f"from {least:.4g}" if math.isfinite(least) else "from any negative multiple"
            high = f"to {most:.4g} times" if math.isfinite(most) else "to any multiple of"
            yield f"  gain margin: stable {low} {high} its gain of {self.found.gain:g}"

    def _curves(self) -> Iterator[str]:
        for curve in self.curves:
            unit, scale = ("%", 1e2) if curve.key == "loss" else ("ms", 1e3)
            rows = [(f"{curve.key} of the sensor's link, {unit}", *(f"{scale * v:.3g}" for v in curve.values))]
            rows += [("decay rate 1/s", *(f"{-g:.4g}" for g in curve.growth))]
            yield from columns(rows, "<" + ">" * len(curve.values))
        yield "  rates of the mean square (jump linear system), with independent ages of messages (docs/worse_loops.md)"

    def _check(self) -> Iterator[str]:
        yield f"  one point checked by simulation: {self.point}"
        if (checked := self.checked) is not None:
            rates = f"decay rate computed {-self.computed:.6g}, simulated {-checked.growth:.6g} 1/s"
            means = "that of the mean against that of the mean square, which grows at least as fast"
            told = means if self.error is None else f"relative error {self.error:.2g}"
            yield f"  {rates} ({counted(checked.runs, 'run')} of {checked.seconds:.3g} s); {told}"
        yield from (f"  {checked}" for checked in self.notes)


def report(
    scene: Scene, name: str, bus: float | None = None, progress: Callable[[int, int], object] = lambda done, of: None
) -> LoopReport:
    """The report on the loop of controller `name`. `bus`: see `budget`. Raises SceneError where there is no loop."""
    margin = loop(scene, name).margins
    meas, act = links(scene, name)
    frame = scene.frame_ns
    late = (mean_age(meas, frame), mean_age(act, frame))
    if not all(map(math.isfinite, late)):
        raise SceneError(scene.name, ["network: a link of this loop loses every message, so there is no loop"])
    delayed = loop(scene, name, sum(map(round, late)) * frame)
    rates = _Rates(scene, name)
    growth, _ = rates.of(meas, act)
    frames = (
        _FREE if margin is None or math.isinf(margin["delay"]) else max(math.ceil(1.3e9 * margin["delay"] / frame), 4)
    )
    half = max(frames // 3, 1) * frame
    steps = np.linspace(0.0, 1.0, POINTS)
    delays = sorted({round(frames * share) * frame for share in steps})
    about = meas if meas.delay else meas.model_copy(update={"delay": half})
    jitters = sorted({round(about.delay * share) for share in steps})
    asked: list[tuple[str, float, Link]] = [("delay", d * 1e-9, Link().model_copy(update={"delay": d})) for d in delays]
    asked += [("jitter", j * 1e-9, about.model_copy(update={"jitter": j, "loss": 0.0})) for j in jitters]
    losses = np.round(steps * _MOST_LOSS, 4).tolist() if rates.jumps else []
    asked += [("loss", p, meas.model_copy(update={"loss": p})) for p in losses]
    drawn: dict[str, list[tuple[float, float]]] = {}
    for done, (key, value, link) in enumerate(asked):
        progress(done, len(asked))
        drawn.setdefault(key, []).append((value, rates.of(link, act)[0]))
    curves = [Curve(key, [v for v, _ in points], [g for _, g in points]) for key, points in drawn.items()]
    point, own = (meas, act), scene.network.links.keys() & {f"meas/{ends(scene, name)[0]}", f"act/{name}"}
    if not own:
        chosen = {"delay": half, "jitter": half // 2, "loss": 0.2} if rates.jumps else {"delay": half}
        point = Link().model_copy(update=chosen), Link()
    result = LoopReport(scene.name, delayed, [*budget(scene, delayed, bus)], growth, curves, "", math.nan)
    _simulate(result, scene, rates, *point)
    result.notes += rates.notes
    progress(len(asked), len(asked))
    return result


class _Rates:
    """Growth rates of the loop of a controller over links. `notes`: how they were found, where it is not as usual."""

    def __init__(self, scene: Scene, name: str) -> None:
        self.scene, self.name = scene, name
        self.jumps = fits(scene, name)
        why = "the loop does not work once in every frame: rates are those of the longest constant delay, and losses"
        self.notes = [] if self.jumps else [f"{why} are left out"]

    def of(self, meas: Link, act: Link) -> tuple[float, Growth]:
        """Growth rate [1/s] over a link of the sensor and one of the commands, and what it is of."""
        decay = (jump_growth if self.jumps else worst_case)(self.scene, self.name, meas, act)
        if math.isfinite(decay.mean_square):
            return decay.mean_square, decay
        note = "some rates are those of the mean: the mean square of a loop of many modes was not found"
        self.notes += [note] if note not in self.notes else []
        return decay.mean, decay


def _simulate(result: LoopReport, scene: Scene, rates: _Rates, meas: Link, act: Link) -> None:
    """Add the simulation of one point to the report."""
    name = rates.name
    sensor, _ = ends(scene, name)
    named = {f"meas/{sensor}": meas, f"act/{name}": act}
    result.point = "; ".join(f"{topic}: {described(dump(link))}" for topic, link in named.items())
    result.computed, of = rates.of(meas, act)
    result.of_mean = not math.isfinite(of.mean_square)
    network = Network(meas={sensor: meas}, act={name: act})
    if not of.hertz:
        result.notes.append("not checked: the least stable mode does not vibrate")
        return
    try:
        result.checked = simulated(scene, name, network, result.computed, of)
    except SceneError as fault:
        result.notes += [f"not checked: {text}" for text in fault.faults]


Ages = Sequence[tuple[int | None, float]]
"""Age of the message that arrives at a tick [frames], None for none, with its probability."""
DENSE = 10
"""Largest number of states for which the map of S is written out as a matrix."""
_RESTARTS = 40
_SEARCHED = 150  # most states for which its radius is searched, in about a second; 316 would take minutes [chosen]


@dataclass(frozen=True)
class Growth:
    """Growth rates [1/s] of a loop over impaired links: of the mean, and of the root of the mean square.

    The latter is NaN where its eigenvalue was not found: rigs of many modes with little damping.
    """

    mean: float
    mean_square: float
    hertz: float
    """Frequency of the mean [Hz]."""
    shape: Array
    """Of the mean, over the states of the plant."""


def latencies(link: Link, frame_ns: int) -> dict[int, float]:
    """Time under way of a message [frames] -> probability, as rig.bus.impaired_link rounds it up."""
    low, count = link.delay - link.jitter, 2 * link.jitter + 1
    least, most = link.ticks(frame_ns)
    ends = [min(max(d * frame_ns - low + 1, 0), count) for d in range(least - 1, most + 1)]
    return {d: (b - a) / count for d, (a, b) in zip(range(least, most + 1), pairwise(ends))}


def ages(link: Link, frame_ns: int) -> Ages:
    """The stationary distribution of what a link delivers at a tick."""
    under_way, kept = latencies(link, frame_ns), 1.0 - link.loss
    least, most = min(under_way), max(under_way)
    arrivals: list[tuple[int | None, float]] = []
    if link.reorder:  # of the messages that arrive at this tick the last one sent counts
        left = 1.0
        for d in range(least, most + 1):
            arrives = kept * under_way.get(d, 0.0)
            arrivals.append((d, left * arrives))
            left *= 1.0 - arrives
        return [*arrivals, (None, left)]
    before = 0.0
    for m in range(least, most + 1):  # every message of age m and above has arrived, or is lost
        there = math.prod(
            link.loss + kept * sum(p for d, p in under_way.items() if d <= age) for age in range(m, most + 1)
        )
        arrivals.append((m, kept * (there - before)))
        before = there
    return [*arrivals, (None, link.loss)]


def mean_age(link: Link, frame_ns: int) -> float:
    """Mean age of the samples that a controller has [frames]; a tick without a message adds one frame."""
    arriving = [(age, p) for age, p in ages(link, frame_ns) if age is not None]
    share = sum(p for _, p in arriving)
    return sum(age * p for age, p in arriving) / share + (1.0 - share) / share if share else math.inf


def fits(scene: Scene, name: str) -> bool:
    """Whether the loop of controller `name` works once in every frame, as `jump_growth` needs."""
    return round(loop(scene, name).model.period * 1e9) == scene.frame_ns


def worst_case(scene: Scene, name: str, meas: Link, act: Link) -> Growth:
    """The growth of a loop if every message takes the longest time that its links allow.

    The age of a sample at an update is a multiple of the shorter period, that of the controller or that of its sensor.
    """
    frame, section = scene.frame_ns, scene.controllers[name]
    period = min(section.period, scene.sensors[ends(scene, name)[0]].period_ns)
    heard = -(-meas.ticks(frame)[1] * frame // period) * period
    closed = loop(scene, name, heard + act.ticks(frame)[1] * frame)
    rate, shape = complex(closed.spectrum.rates[0]), closed.spectrum.right[: closed.model.own, 0].real
    return Growth(rate.real, rate.real, abs(rate.imag) / (2.0 * math.pi), shape)


def jump_growth(scene: Scene, name: str, meas: Link, act: Link) -> Growth:
    """The growth of the loop of controller `name` over a link of its sensor and one of its commands.

    For a loop that `fits`. Raises SceneError as `rig.analysis.control_loop.loop` does.
    """
    frame = scene.frame_ns
    heard, commanded = ages(meas, frame), ages(act, frame)
    longest = max((age for age, _ in commanded if age is not None), default=0)
    loops = {
        age: loop(scene, name, longest * frame, None if age is None else longest - age)
        for age, p in commanded
        if p > 0.0
    }
    cases = [(p * q, _case(loops[a], age, heard)) for a, p in commanded if p > 0.0 for age, q in heard if q > 0.0]
    period = frame * 1e-9
    z, shapes = np.linalg.eig(sum(p * A for p, A in cases))
    fastest = np.abs(z).argmax()
    mean, shape = complex(z[fastest]), shapes[: next(iter(loops.values())).model.own, fastest].real
    hertz = abs(cmath.phase(mean)) / (2.0 * math.pi * period)
    return Growth(math.log(abs(mean)) / period, 0.5 * math.log(_radius(cases)) / period, hertz, shape)


def _case(cut: Loop, age: int | None, heard: Ages) -> Array:
    """The matrix over [z, measurements under way (the newest first), the measurement heard last]."""
    m, gain = cut.model, cut.gain
    n, under_way = len(m.F), max((a for a, _ in heard if a is not None), default=0)
    size = n + under_way + 1
    reads = np.zeros(size)
    if age is None:
        reads[-1] = 1.0
    elif age:
        reads[n + age - 1] = 1.0
    else:
        reads[:n] = m.H
    A = np.zeros((size, size))
    A[:n, :n] = m.F
    A[:n] += gain * np.outer(m.G, reads)
    if under_way:
        A[n, :n] = m.H
        A[n + 1 : n + under_way, n : n + under_way - 1] = np.eye(under_way - 1)
    A[-1] = reads
    return A


def _radius(cases: Sequence[tuple[float, Array]]) -> float:
    """The spectral radius of S -> sum p A S A^T."""
    size = len(cases[0][1])
    if len(cases) == 1:
        return float(np.abs(np.linalg.eigvals(cases[0][1])).max()) ** 2
    scale = np.maximum(np.max([np.abs(A).max(axis=1) for _, A in cases], axis=0), 1e-300)
    scaled = [(p, A / scale[:, None] * scale) for p, A in cases]  # states of similar size: the same eigenvalues
    if size <= DENSE:
        return float(np.abs(np.linalg.eigvals(sum(p * np.kron(A, A) for p, A in scaled))).max())
    if size > _SEARCHED:
        return math.nan
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

    def after(s: Array) -> Array:
        S = s.reshape(size, size)
        return np.asarray(sum(p * (A @ S @ A.T) for p, A in scaled)).ravel()

    operator = LinearOperator((size * size, size * size), matvec=after, dtype=np.float64)  # type: ignore[call-arg]
    start = np.eye(size).ravel()
    try:
        largest = eigs(operator, k=4, ncv=40, v0=start, tol=1e-10, maxiter=_RESTARTS, return_eigenvectors=False)
    except ArpackNoConvergence:
        return math.nan
    return float(np.abs(largest).max())
