"""Parameters of the lever rig, identified from experiments with the virtual instruments as on a real bench.

free vibration     x = A exp(-b t) cos(w t + ..);  J = k1 r1^2 / (w^2 + b^2), c1 = 2 b J
                   of the lever with (k2 + k3) r3^2 in place of k1 r1^2: I, c2
static friction    mu_s = k1 r1^2 phi_max / (r2 N): the largest deflection to which a creeping disc carries the pin
kinetic friction   mu = F r1 / (r2 N) of the load cell's force F; mu_k, alpha (and mu_s) of the exponential law, fitted

Stiffnesses and lengths count as known (weighed, measured). Everything else comes from the sensors of the scene.
Source: Liu and Ouyang, Mechanical Systems and Signal Processing (2022), section 3.1, equations 22 to 30.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.plants.lever import Parameters
from rig.printable import columns
from rig.record.run import Run
from rig.results import Result
from rig.scenes.protocol import Hold, Repeat
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
_SETTLED = 0.5  # share of a hold after which a reading is taken
_CURVE = 400  # points of a fitted curve
_SKIP = 3  # samples left out: until then the laser's reading is not yet the free vibration alone


@dataclass(frozen=True)
class Parameter:
    """An identified parameter beside the value that the scene states, in SI."""

    key: str
    unit: str
    found: float
    stated: float

    @property
    def error(self) -> float:
        """Difference from the stated value, relative to it."""
        return self.found / self.stated - 1.0


class Fit(NamedTuple):
    """What was measured [n] and the model with the identified parameters [m], over one axis, in SI.

    `x_name`, `y_name`: names of the axes with their units.
    """

    x_name: str
    y_name: str
    x: Array
    y: Array
    model_x: Array
    model_y: Array


@dataclass(frozen=True)
class Identified(Result):
    """The result of an experiment. `readings`: column names and the fitted numbers, if there are any."""

    FIGURE: ClassVar = "rig.analysis.figures:identification_figure"

    scene: str
    experiment: str
    parameters: tuple[Parameter, ...]
    fit: Fit
    columns: tuple[str, ...] = ()
    readings: tuple[tuple[float, ...], ...] = ()

    def text(self) -> str:
        """Return the report as text."""
        rows = [("", "found", "stated", "error", "")]
        for parameter in self.parameters:
            unit = "" if parameter.unit == "1" else parameter.unit
            rows.append(
                (
                    parameter.key,
                    f"{parameter.found:.6g}",
                    f"{parameter.stated:.6g}",
                    f"{100.0 * parameter.error:.2f} %",
                    unit,
                )
            )
        lines = [f"{self.scene}: {self.experiment}", *columns(rows, "<>>><")]
        if self.readings:
            readings = [[f"{value:.6g}" for value in row] for row in self.readings]
            lines += ["", *columns([self.columns, *readings], ">" * len(self.columns))]
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "scene": self.scene,
            "experiment": self.experiment,
            "parameters": [{**vars(parameter), "error": parameter.error} for parameter in self.parameters],
            "readings": [dict(zip(self.columns, row)) for row in self.readings],
        }


def identify(scene: Scene) -> Identified:
    """Run the experiment that the scene defines and identify its parameters. Raises UsageError for another scene."""
    from rig.bench.run.simulate import simulate

    _reader(scene)
    return read(simulate(scene, {}))


def read(run: Run) -> Identified:
    """Identify the parameters from a simulated or recorded run. Raises UsageError for a scene that is no such
    experiment.
    """
    scene = Scene.from_json(run.scene_text())
    return _reader(scene)(scene, run)


def _reader(scene: Scene) -> Callable[[Scene, Run], Identified]:
    p = scene.parameters
    if not isinstance(p, Parameters):
        raise UsageError(f"{scene.name}: no experiment identifies a {scene.plant}; experiments exist for a lever")
    if p.disc is None and (p.lever is None or p.cylinder.bolted):
        return _free_vibration
    if p.disc is not None and p.lever is None:
        return _static_friction if p.load_cell is None else _kinetic_friction
    raise UsageError(
        f"{scene.name}: is not an identification experiment; these scenes are: lever_free_cylinder, "
        "lever_free_lever, lever_static_friction, lever_kinetic_friction"
    )


def _free_vibration(scene: Scene, run: Run) -> Identified:
    p: Any = scene.parameters
    c, of = p.cylinder, "lever" if p.cylinder.bolted else "cylinder"
    if c.bolted:
        output, part = "lever_displacement", p.lever
        stiffness = (p.springs.fixture.stiffness + p.springs.tail.stiffness) * part.leg**2
    else:
        output, part, stiffness = "arm_displacement", c, p.springs.arm.stiffness * c.arm**2
    t, x = _measured(scene, run, output)
    t, x = t[_SKIP:], x[_SKIP:]
    frequency, decay = vibration(t, x)
    inertia = stiffness / (frequency**2 + decay**2)
    parameters = (
        Parameter(f"{of}.inertia", "kg*m^2", inertia, part.inertia),
        Parameter(f"{of}.damping", "N*m*s/rad", 2.0 * decay * inertia, part.damping),
    )
    fit = Fit("time [s]", f"{output.replace('_', ' ')} [m]", t, x, t, x - _left(t, x, frequency, decay))
    return Identified(scene.name, f"free vibration of the {of}", parameters, fit)


def vibration(t: Array, x: Array) -> tuple[float, float]:
    """Fit frequency w [rad/s] and decay b [1/s] of x = exp(-b t) (A cos w t + B sin w t) + C by least squares.

    t: evenly spaced [s].
    """
    from scipy.optimize import least_squares

    step = float(t[1] - t[0])
    count = 8 * len(x)
    spectrum = np.abs(np.fft.rfft(x - x[len(x) // 2 :].mean(), count))
    first = 2.0 * np.pi * float(np.fft.rfftfreq(count, step)[spectrum.argmax()])
    guess = np.array([first, 0.05 * first])
    fitted = least_squares(lambda wb: _left(t, x, *wb), guess, x_scale=guess, ftol=1e-14, xtol=1e-14, gtol=1e-14).x
    return float(fitted[0]), float(fitted[1])


def _left(t: Array, x: Array, w: float, b: float) -> Array:
    """What a free vibration of frequency w [rad/s] and decay b [1/s] leaves of x with the best A, B and C."""
    rings = t - t[0]
    fading = np.exp(-b * rings)
    shapes = np.stack((fading * np.cos(w * rings), fading * np.sin(w * rings), np.ones_like(rings)), axis=1)
    return np.asarray(x - shapes @ np.linalg.lstsq(shapes, x, rcond=None)[0])


def _static_friction(scene: Scene, run: Run) -> Identified:
    p: Any = scene.parameters
    t, x = _measured(scene, run, "arm_displacement")
    at, N = _measured(scene, run, "normal_force")
    readings = []
    for begin, end in _holds(scene.protocol):
        pressed = float(N[(at >= begin) & (at < end)].mean())
        reach = float(x[(t >= begin) & (t < end)].max() - x[0])
        mu = p.springs.arm.stiffness * p.cylinder.arm * reach / (p.cylinder.pin * pressed)
        readings.append((pressed, reach, mu))
    mean = float(np.mean([mu for *_, mu in readings]))
    parameters = (Parameter("friction.mu_static", "1", mean, p.friction.friction().static),)
    load, _, each = np.array(readings).T
    fit = Fit(
        "normal force [N]",
        "static coefficient of friction",
        load,
        each,
        np.array([load.min(), load.max()]),
        np.array([mean, mean]),
    )
    return Identified(scene.name, "static friction", parameters, fit, ("load N", "deflection m", "mu"), tuple(readings))


def _kinetic_friction(scene: Scene, run: Run) -> Identified:
    from scipy.optimize import curve_fit

    p: Any = scene.parameters
    if p.friction.law != "exponential":
        raise UsageError(f"{scene.name}: friction.law = {p.friction.law!r}: only the exponential law can be fitted")
    quantities = ("disc_speed", "cell_force", "normal_force")
    signals = [_measured(scene, run, quantity) for quantity in quantities]
    readings = []
    for begin, end in _holds(scene.protocol):
        settled = begin + _SETTLED * (end - begin)
        speed, force, load = (float(x[(t >= settled) & (t < end)].mean()) for t, x in signals)
        readings.append((p.disc.radius * speed, force * p.cylinder.arm / (p.cylinder.pin * load)))
    v, mu = np.array(sorted(readings)).T

    def law(v: Array, static: float, kinetic: float, decay: float) -> Array:
        return np.asarray(kinetic + (static - kinetic) * np.exp(-decay * v))

    guess = (float(mu[0]), float(mu[-1]), 1.0 / float(np.median(v)))
    (static, kinetic, decay), _ = curve_fit(law, v, mu, guess)
    parameters = (
        Parameter("friction.mu_static", "1", float(static), p.friction.mu_static),
        Parameter("friction.mu_kinetic", "1", float(kinetic), p.friction.mu_kinetic),
        Parameter("friction.decay", "s/m", float(decay), p.friction.decay),
    )
    speeds = np.linspace(v[0], v[-1], _CURVE)
    fit = Fit("slip speed [m/s]", "kinetic coefficient of friction", v, mu, speeds, law(speeds, static, kinetic, decay))
    return Identified(
        scene.name, "kinetic friction over speed", parameters, fit, ("slip speed m/s", "mu"), tuple(readings)
    )


def _measured(scene: Scene, run: Run, quantity: str) -> tuple[Array, Array]:
    """Times [s] and values [unit of the quantity] of the sensor that reads `quantity`."""
    for name, sensor in scene.sensors.items():
        if sensor.reads == quantity:
            samples = run.measurements[name]
            return np.asarray(samples.t_ns * 1e-9), np.asarray(samples.v / sensor.sensitivity)
    raise UsageError(f"{scene.name}: needs a sensor that reads {quantity}")


def _holds(protocol: Iterable[Any]) -> list[tuple[float, float]]:
    """Begin and end [s] of each hold of a protocol without waits."""
    holds, now = [], 0
    for step in _unrolled(protocol):
        length = getattr(step, "time", 0) or getattr(step, "over", 0)
        if isinstance(step, Hold):
            holds.append((now * 1e-9, (now + length) * 1e-9))
        now += length
    return holds


def _unrolled(steps: Iterable[Any]) -> Iterator[Any]:
    for step in steps:
        if isinstance(step, Repeat):
            for _ in range(int(step.times)):
                yield from _unrolled(step.steps)
        else:
            yield step
