"""A slider on a rotating flexible disc: mode coupling, falling friction and moving load in one rig.

    m s'' + ct s' + kt s + ki/2 (s - u) = T                      s = r0 phi along the disc
    m u'' + cn u' + ki/2 (u - s)        = N - F0                 u away from it
    N = kc (w(r0, phi) - u),   v = r0 Omega - s'
    w(r, theta) = sum R(r) (C cos l theta + S sin l theta)       in the fixed frame, summed over the disc's modes
    C'' + 2 l Omega S' + (omega^2 - l^2 Omega^2) C + 2 zeta omega (C' + l Omega S) = -R (N cos l phi + M l sin l phi)
    S'' - 2 l Omega C' + (omega^2 - l^2 Omega^2) S + 2 zeta omega (S' - l Omega C) = -R (N sin l phi - M l cos l phi)
    M = h T / (2 r0)

The disc turns towards +theta under the slider. Friction acts on the upper face, half a thickness from the middle plane,
and so bends the disc (M). The damping is that of the rotating material. If the scene changes the disc speed, its terms
are products of states, and l Omega' S, -l Omega' C are added to 2 l Omega S', -2 l Omega C'.
Source: Liu and Ouyang, Meccanica 55 (2020), section 3, equations 16 to 30 and appendix.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import model_validator

from rig.about import SetPoint
from rig.effects import dither, drive, load
from rig.effects.disc_modes import Disc, Geometry, Mode, Slope, free_modes
from rig.effects.dither import MassDither
from rig.effects.load import Load
from rig.effects.noise import Noisy
from rig.effects.separation import Separation
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Part
from rig.picture import Own, Plot
from rig.plants.belt import RAMPED, contact_outputs
from rig.plants.structures.same_modes import keyed, refuse_others
from rig.quantities import (
    Angle,
    Hand,
    Kilogram,
    Metre,
    MetrePerSecond,
    NewtonPerMetre,
    NewtonSecondPerMetre,
    NonNegativeNewtonPerMetre,
    PositiveMetre,
    RadianPerSecond,
    Section,
    refused,
)

HANDS = {
    "drive.speed": Hand("disc speed", 0.0, 3.0),
    "load.force": Hand("normal force"),
    "friction.mu_static": Hand("friction coefficient at rest"),
    "slider.damping": Hand("damping of the slider", 0.0, 4.0),
    "dither.amplitude": Hand("dither amplitude"),
}
PICTURES = (Own("rig.view.pendulum:Slider", ("displacement", "height", "disc_speed")),)


class Slider(Section):
    """The slider: mass, radius r0 of its position, springs and dampers along and across the disc.

    `tangential` kt, `inclined` ki (at 45 degrees, anchored above and behind), `contact` kc: springs.
    """

    mass: Kilogram
    radius: PositiveMetre
    tangential: NewtonPerMetre
    inclined: NonNegativeNewtonPerMetre
    contact: NewtonPerMetre
    damping: NewtonSecondPerMetre = 0.0
    normal_damping: NewtonSecondPerMetre = 0.0


class Drive(Section):
    """The drive of the disc: its speed [rad/s]."""

    speed: Annotated[RadianPerSecond, SetPoint()]


class Probe(Section):
    """The measured point of the disc: radius [m], and angle [rad] in the fixed frame from the unmoved slider."""

    radius: PositiveMetre
    angle: Angle = 0.0


class Start(Section):
    """Position and velocity of the slider at the start; zero: springs unloaded, slider just touching the flat disc.

    The disc is at rest with the static deflection under the contact force of this height.
    """

    displacement: Metre = 0.0
    velocity: MetrePerSecond = 0.0
    height: Metre = 0.0
    height_velocity: MetrePerSecond = 0.0


class Parameters(Noisy):
    """The tables of a disc_slider scene. `load`: the preload F0."""

    disc: Disc
    slider: Slider
    drive: Drive
    load: Load
    friction: Friction
    probe: Probe
    geometry: Geometry | None = None
    slope: Slope | None = None
    separation: Separation | None = None
    dither: MassDither | None = None
    start: Start = Start()

    @model_validator(mode="after")
    def _on_the_disc(self) -> Self:
        named = {"slider.radius": self.slider.radius, "probe.radius": self.probe.radius}
        if wrong := [(name, fault) for name, radius in named.items() if (fault := self.disc.off(radius))]:
            raise refused(wrong)
        return self

    def continuing(self, begun: Self) -> Self:
        """See `Section.continuing`: the modes of the disc stay."""
        refuse_others(self._of_modes, begun._of_modes)
        return self

    @property
    def _of_modes(self) -> dict[str, Any]:
        """The values that the shapes of the modes depend on."""
        return keyed("disc", self.disc, ("modulus", "damping_ratio"))


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    slider = p.slider
    r0 = p.slider.radius
    modes = free_modes(p.disc)
    a = Assembly(title="disc_slider")
    a.coordinate("s", slider.mass, slider.damping, slider.tangential + 0.5 * slider.inclined)
    a.coordinate("u", slider.mass, slider.normal_damping, 0.5 * slider.inclined)
    a.stiffness["s", "u"] = a.stiffness["u", "s"] = -0.5 * slider.inclined
    for mode in modes:
        for name in mode.names:
            a.coordinate(name, 1.0, 2.0 * p.disc.damping_ratio * mode.omega, mode.omega**2)
    a.start |= {"s": p.start.displacement, "s'": p.start.velocity, "u": p.start.height, "u'": p.start.height_velocity}

    compliance = sum(mode.at(r0) ** 2 / mode.omega**2 for mode in modes)
    force = -slider.contact * p.start.height / (1.0 + slider.contact * compliance)
    a.start |= {mode.names[0]: -mode.at(r0) * force / mode.omega**2 for mode in modes}

    free = (-math.inf, math.inf)
    most = drive.FASTEST["rad/s"]
    speed = drive.actuator(a, "drive.speed", "rad/s", p.drive.speed, 0.0, free, most, None, "drive", moved)
    for mode in modes:
        if mode.pair:
            _turn(a, mode, p, speed)
    a.push("u", {name: -value for name, value in load.add(a, p.load, moved).items()})

    lift = {mode.names[0]: mode.at(r0) for mode in modes}  # deflection at the unmoved slider
    bend = {mode.names[1]: 0.5 * p.disc.thickness / r0 * mode.diameters * mode.at(r0) for mode in modes if mode.pair}
    surface = {name: r0 * value for name, value in speed.items()}
    a.patch("contact", {"s": 1.0} | bend, surface, p.friction.friction(), {"s": 1.0})
    pressed = {name: slider.contact * value for name, value in lift.items()} | {"u": -slider.contact}
    a.normal(
        "load",
        "contact",
        pressed,
        {"u": 1.0} | {name: -value for name, value in lift.items()},
        opens=p.separation is not None,
    )
    for mode in modes:
        if mode.pair:
            if p.geometry is not None:
                _move(a, mode, p, lift, bend)
            if p.slope is not None:
                _incline(a, mode, p)
    if p.dither is not None:
        dither.add(a, p.dither, "contact", "load", "s")

    seen = deflection(modes, p.probe.radius, p.probe.angle)
    a.outputs |= contact_outputs({"s": 1.0}, a)
    a.outputs |= {
        "angle": Output({"s": 1.0 / r0}, "rad"),
        "height": Output({"u": 1.0}, "m", Plot()),
        "height_velocity": Output({"u'": 1.0}, "m/s", Plot()),
        "deflection": Output(seen, "m", Plot()),
        "deflection_velocity": Output({f"{name}'": value for name, value in seen.items()}, "m/s", Plot()),
        "disc_speed": Output(dict(speed), "rad/s", role="drive"),
    }
    a.free = {
        f"disc, {mode.circles} circles, {mode.diameters} diameters{part}": mode.omega / (2.0 * math.pi)
        for mode in modes
        for part in ((", cosine", ", sine") if mode.pair else ("",))
    }
    return a


def deflection(modes: tuple[Mode, ...], radius: float, angle: float) -> dict[str, float]:
    """The deflection w [m] at a radius [m] and an angle [rad] of the fixed frame, as a row over coordinates."""
    row: dict[str, float] = {}
    for mode in modes:
        around = math.cos(mode.diameters * angle), math.sin(mode.diameters * angle)
        row |= {name: mode.at(radius) * part for name, part in zip(mode.names, around)}
    return row


def _turn(a: Assembly, mode: Mode, p: Parameters, speed: dict[str, float]) -> None:
    """Add the terms of the rotation of the disc to a pair of modes, in the fixed frame."""
    l = mode.diameters
    damper = 2.0 * p.disc.damping_ratio * mode.omega
    cosine, sine = mode.names
    [(state, value)] = speed.items()
    for name, other, sign in ((cosine, sine, 1.0), (sine, cosine, -1.0)):
        if state == "one":
            a.damping[name, other] = sign * 2.0 * l * value
            a.stiffness[name, name] -= (l * value) ** 2
            a.push(name, {other: -sign * damper * l * value})  # a force of the drive, not of a spring
            continue
        _product(a, name, -sign * 2.0 * l, state, f"{other}'")
        _product(a, name, float(l * l), state, state, name)
        _product(a, name, -sign * damper * l, state, other)
        if "drive.slope" in a.signals:
            _product(a, name, -sign * l, "drive.slope", other)


def _move(a: Assembly, mode: Mode, p: Parameters, lift: dict[str, float], bend: dict[str, float]) -> None:
    """Add the terms that the angle of the slider changes: in the normal force, in both forces on a pair of modes."""
    cosine, sine = mode.names
    turned = {"s": mode.diameters / p.slider.radius}
    away = ("cos-1", turned)
    aside = ("sin", turned)
    a.product(f"{cosine} cos-1", cosine, away)
    a.product(f"{sine} sin", sine, aside)
    a.load("load").update(dict.fromkeys((f"{cosine} cos-1", f"{sine} sin"), p.slider.contact * lift[cosine]))
    for name, force, factor, coefficient in (
        (cosine, "N:load", away, -lift[cosine]),
        (sine, "N:load", aside, -lift[cosine]),
        (cosine, "T:contact", aside, -bend[sine]),
        (sine, "T:contact", away, bend[sine]),
    ):
        label = f"{force} {factor[0]} {mode.diameters}"
        a.product(label, force, factor)
        a.push(name, {label: coefficient})


def _incline(a: Assembly, mode: Mode, p: Parameters) -> None:
    """Add the force -N dw / (r0 dtheta) on the slider."""
    cosine, sine = mode.names
    gain = mode.diameters * mode.at(p.slider.radius) / p.slider.radius
    turned = {"s": mode.diameters / p.slider.radius}
    _product(a, "s", -gain, "N:load", sine)
    if p.geometry is not None:
        _product(a, "s", gain, "N:load", cosine, ("sin", turned))
        _product(a, "s", -gain, "N:load", sine, ("cos-1", turned))


def _product(a: Assembly, coordinate: str, coefficient: float, *factors: Part) -> None:
    """Add `coefficient` times a product as a force on a coordinate."""
    label = " ".join(factor if isinstance(factor, str) else factor[0] for factor in factors)
    a.product(label, *factors)
    a.push(coordinate, {label: coefficient})
