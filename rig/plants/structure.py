"""A structure of the user's own: matrices of a finite element program, or typed in; contacts, loads, a piezo stack.

    M q'' + D q' + K q = sum_c (n_c N_c + t_c T_c) + p F        N_c = -k_c n_c q - d_c n_c q',  w_c = r_c W - t_c q'
    M, D, K: sums of parts; a part may be multiplied by a number of the scene: KEY, KEY^2 or 1/KEY

n_c, t_c: rows of contact point c, gap and motion along the sliding relative to the master. k_c is the stiffness per
area times the area of the point, in series with the flexibility that a reduction leaves out. p F: the load. The
coordinates q are those of the matrices, or of a reduced model (rig.structure), which is kept on disk and in recordings.

Steady sliding is the equilibrium with every point closed; a run starts there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rig.effects import drive, load, piezo
from rig.effects.drive import actuator
from rig.errors import SceneError
from rig.model import film
from rig.model.assembly import Accuracy, Assembly, Input, Nodes, Output
from rig.model.film import Film
from rig.model.friction_law import Law
from rig.model.method import CROWD
from rig.model.named_rows import Row
from rig.model.system import Finding, System
from rig.picture import Own, Plot
from rig.plants.belt import RAMPED
from rig.plants.structures.contact_map import Surface, surface_of
from rig.plants.structures.structure_model import Given, basis_in_run, full, reduced, values_of
from rig.plants.structures.structure_tables import Tables, Turning
from rig.quantities import Hand
from rig.solve.film_steps import COUNTED
from rig.solve.records import CLOSED, OPEN
from rig.stability.linearisation import Steady, sliding_key, steady
from rig.structure import estimate
from rig.structure.full import Doubt, Full, Part, Points
from rig.structure.reduced import Reduced
from rig.structure.stated import Stated

Array = NDArray[np.float64]
_SAME = 1e-9  # of the largest entry: rows of the sliding that are equal belong to one contact
DRAWN = 4000  # nodes that mode shapes are drawn on, at most [chosen]
_OF_POINTS = Plot("normal force of points"), Plot("slip speed of points"), Plot("0 open, 1 stick, 2 slip")
_RELATIVE = Plot("surface past the structure at points")
_ROUNDS = 60  # most rounds to the loads of contacts in steady sliding
_SETTLED = 1e-12  # relative change of these loads in the last round

HANDS = {
    "friction.mu": Hand("coefficient of friction"),
    "drive.speed": Hand("disc speed"),
    "load.force": Hand("normal force"),
    "damping.ratio": Hand("damping ratio", 0.0, 10.0),
}
PICTURES = (Own("rig.view.surfaces:Surfaces", ("normal_force", "friction_force", "surface_speed")),)


class Parameters(Tables):
    """The tables of a structure scene; their module tells the plant."""

    def continuing(self, begun: Self) -> Self:
        """See `Section.continuing`: the reduced structure keeps its basis."""
        return self.on_basis(basis_in_run(self, begun))

    def comparable(self, other: Self) -> bool:
        """See `Section.comparable`: coordinates of a reduced structure mean motions of its basis."""
        own = Given(self)
        of_other = Given(other)
        return own.reduction.kind == of_other.reduction.kind == "whole" or own.alike(of_other)

    @property
    def stated(self) -> Stated | None:
        """What is stated of mass, contacts and bodies; None for typed matrices."""
        return None if self.structure.typed else Stated.of(reduced(self))

    @property
    def contact_surfaces(self) -> Iterator[Surface]:
        """The contacts on maps of pressures, in order; without those of typed rows, which have no places."""
        meshed = [contact for contact in reduced(self).model.contacts if self.contacts[contact.name].gap is None]
        for points in meshed if self.friction is not None else ():
            contact = self.contacts[points.name]
            outputs = tuple(f"normal_force_of_{name}" for name in _names(points))
            normal = None
            if not isinstance(contact.normal, str) and contact.rows is None:
                normal = np.array(contact.normal)
            axis = None
            centre = np.zeros(3)
            if isinstance(self.drive, Turning) and contact.sliding is None:
                axis = np.array(self.drive.axis)
                centre = np.array(self.drive.centre)
            surface = surface_of(points, outputs, normal, axis, centre)
            if surface is not None:
                yield surface


class _Sliding(NamedTuple):
    """What the points of one patch have in common: `along` [coordinate], radius [m], law."""

    patch: str
    along: Array
    radius: float
    law: Law

    def fits(self, along: Array, radius: float, law: Law) -> bool:
        """Whether a point with these numbers belongs to the patch."""
        if radius != self.radius or law != self.law:
            return False
        return bool(np.abs(along - self.along).max() <= _SAME * np.abs(self.along).max())


def _names(points: Points) -> list[str]:
    """The names of the points of a contact."""
    count = len(points.area)
    return [points.name] if count == 1 else [f"{points.name}_{i}" for i in range(1, count + 1)]


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant.

    Raises SceneError with every fault of the files.
    """
    whole = reduced(p)
    model = whole.model
    of_scene = p.numbers
    given = values_of(p)
    typed = p.structure.coordinates if whole.kind == "whole" else None
    names = typed or tuple(f"q{i}" for i in range(1, model.rows + 1))
    scaling = {part.scaling[0] for part in p.structure.parts.values()} - {""}
    moved = {name: how for name, how in moved.items() if name not in scaling}
    mass = model.matrix("mass", given)
    damping = model.matrix("damping", given)
    stiffness = model.matrix("stiffness", given)
    if p.damping.table is not None:
        damping = damping + _modal(p.damping.table, mass, stiffness)
    a = Assembly(title="structure")
    a.block(names, mass, damping, stiffness)

    def row(vector: Array, rate: str = "", factor: float = 1.0) -> Row:
        return {f"{name}{rate}": factor * value for name, value in zip(names, vector.tolist()) if value}

    speed: Row = {}
    if p.drive is not None:
        unit = "rad/s" if isinstance(p.drive, Turning) else "m/s"
        speed = drive.add(a, p.drive, unit, moved)
        a.outputs["drive_speed"] = Output(dict(speed), unit, role="drive")
    pressing = np.zeros(len(names))
    if p.load is not None:
        force = load.add(a, p.load, moved)
        pressing = sum((model.vectors[f"load.at.{name}"] for name in p.load.at), pressing)
        for name, share in row(pressing).items():
            a.push(name, {state: share * value for state, value in force.items()})
    for name, shaker in p.actuators.items():
        key = f"actuators.{name}.force"
        bounds = (-shaker.limit, shaker.limit)
        pushed = actuator(a, key, "N", shaker.force, 0.0, bounds, shaker.limit, None, f"actuators.{name}", moved)
        for coordinate, share in row(model.vectors[f"actuators.{name}.at"]).items():
            a.push(coordinate, {state: share * value for state, value in pushed.items()})
    springs = [points.springs(given) for points in model.contacts]
    stated = p.stated
    if stated is not None and stated.doubts:
        a.judges.append(partial(_doubts, stated.doubts))
    if p.friction is not None:
        dampers = [points.dampers(given) for points in model.contacts]
        _add_contacts(a, p, model, springs, dampers, speed, row)
    if p.piezo is not None:
        piezo.add(a, p, row(model.forces[1][-1]), moved)
    for name in p.outputs:
        place = model.vectors[f"outputs.{name}"]
        first = name == next(iter(p.outputs))
        a.outputs[f"{name}_displacement"] = Output(row(place), "m", role="displacement" if first else "")
        a.outputs[f"{name}_velocity"] = Output(row(place, "'"), "m/s", role="velocity" if first else "")
        a.outputs[f"{name}_acceleration"] = Output(row(place, "''"), "m/s^2")
    struck = p.knock.at or next(iter(p.outputs if not p.contacts else ()), None)
    if struck is not None:
        a.struck = row(model.vectors[f"outputs.{struck}"])
    for key in scaling:
        value, unit = of_scene[key]
        a.inputs[key] = Input(unit, *_range(key, value, model.parts), value, value, ramped="keep it constant")
    _begin(a, p, mass, stiffness, springs, model, pressing)
    if len(whole.model.ids):
        a.nodes = partial(_nodes, whole, names)
    if whole.kind != "whole":
        a.accuracy = partial(_accuracy, p, whole)
        a.outside = tuple(whole.outside(given))
        a.up_to = whole.up_to / (2.0 * math.pi)
    return a


def _nodes(whole: Reduced, names: tuple[str, ...]) -> Nodes:
    """At most `DRAWN` nodes of the mesh: those of its outer faces, or without faces those that have rows."""
    model = whole.model
    displacements = (model.direction >= 0) & (model.direction < 3)
    free = np.flatnonzero(np.isin(model.node, model.ids) & displacements)
    at = np.searchsorted(model.ids, model.node[free])
    faces = _coarser(model.xyz, model.faces)
    if len(faces):
        places = np.unique(faces)
    else:
        places = np.unique(at)
        places = places[:: -(-len(places) // DRAWN)]
    seen = np.isin(at, places)
    free = free[seen]
    of = np.searchsorted(places, at[seen])
    rows = np.zeros((len(places), 3, len(names)))
    shares = model.share[free, None] * whole.basis[free]
    np.add.at(rows, (of, model.direction[free]), shares)
    corners = np.searchsorted(places, faces).astype(np.int32)
    return Nodes(model.xyz[places], rows, names, corners)


def _coarser(xyz: Array, faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Faces of at most `DRAWN` nodes: beyond, one node stands for all nodes of one body in a cube."""
    import scipy.sparse as sp  # only where shapes are drawn
    from scipy.sparse import csgraph

    used, at = np.unique(faces, return_inverse=True)
    at = at.reshape(faces.shape)
    if len(used) <= DRAWN:
        return faces
    sides = (np.ones(faces.size), (at.ravel(), np.roll(at, 1, axis=1).ravel()))
    graph = sp.csr_array(sides, shape=(len(used),) * 2)
    bodies, body = csgraph.connected_components(graph, directed=False)
    if bodies > DRAWN:
        body = np.zeros_like(body)
    places = xyz[used] - xyz[used].min(axis=0)
    joined = faces
    width = (places.max() or 1.0) / 200.0
    while len(np.unique(joined)) > DRAWN:
        cubes = np.column_stack([np.floor(places / width), body])
        _, first, of = np.unique(cubes, axis=0, return_index=True, return_inverse=True)
        joined = used[first[of.ravel()]][at]
        width = 1.2 * width
    corners = np.sort(joined, axis=1)
    _, once = np.unique(corners, axis=0, return_index=True)
    different = 1 + (np.diff(corners, axis=1) > 0).sum(axis=1)
    kept = np.intersect1d(once, np.flatnonzero(different >= 3))
    return joined[kept]


def _accuracy(p: Tables, whole: Reduced, jacobian: Array, errors_only: bool) -> Accuracy:
    """The estimated errors of the eigenvalues of a reduced structure, and what they do not tell."""
    given = values_of(p)
    notes = list(whole.outside(given))
    damping = None
    if p.damping.table is not None:
        mass = whole.model.matrix("mass", given)
        stiffness = whole.model.matrix("stiffness", given)
        damping = _modal(p.damping.table, mass, stiffness)
    if not errors_only:
        notes += estimate.weaker_modes(whole, given, jacobian)
        notes += estimate.growing_without_friction(whole, given, damping)
    try:
        estimates = _estimator(Given(p), whole.up_to).at(whole, given, damping, jacobian)
    except (SceneError, OSError):
        notes.append("errors of the eigenvalues are not estimated: the files of the matrices are not there")
        return Accuracy(np.zeros(0, np.complex128), np.zeros(0), tuple(notes))
    worst = estimates.relative.max(initial=0.0)
    if worst > p.reduction.error:
        hertz = estimates.values[int(estimates.relative.argmax())].imag / (2.0 * math.pi)
        remedy = "use more modes or vectors, or a lower reduction.up_to"
        if p.reduction.residual == "spring":
            remedy = 'use reduction.residual = "attachment", or more modes'
        notes.append(
            f"the estimated error at {hertz:.4g} Hz is {worst:.1e}, above reduction.error {p.reduction.error:g}; "
            f"{remedy}"
        )
    return Accuracy(estimates.values, estimates.relative, tuple(notes))


@lru_cache(maxsize=1)
def _estimator(given: Given, up_to: float) -> estimate.Estimator:
    return estimate.Estimator(full(given.parameters)[0], up_to, values_of(given.parameters))


def _modal(table: tuple[tuple[float, float], ...], mass: Array, stiffness: Array) -> Array:
    """The damping matrix of ratios over frequency [Hz], for the vibration modes without contacts."""
    from scipy.linalg import eigh

    squares, shapes = eigh(0.5 * (stiffness + stiffness.T), mass)
    omega = np.sqrt(np.maximum(squares, 0.0))
    hertz, ratio = np.array(table).T
    weighed = mass @ shapes
    ratios = np.interp(omega / (2.0 * math.pi), hertz, ratio)
    return np.asarray((weighed * (2.0 * omega * ratios)) @ weighed.T)


def _add_contacts(
    a: Assembly,
    p: Parameters,
    model: Full,
    springs: list[Array],
    dampers: list[Array],
    speed: Row,
    row: Callable[..., Row],
) -> None:
    """Add friction patches and normal forces; points with the same slip speed and law belong to one patch."""
    patches: list[_Sliding] = []
    of_points: dict[str, Output] = {}
    for points, stiffness, damping in zip(model.contacts, springs, dampers):
        contact = p.contacts[points.name]
        law = p.law_of(points.name)
        for i, (name, normal, along) in enumerate(zip(_names(points), points.normal, points.along)):
            radius = float(points.radius[i])
            fitting = (sliding.patch for sliding in patches if sliding.fits(along, radius, law))
            patch = next(fitting, "")
            if not patch:
                patch = name
                patches.append(_Sliding(patch, along, radius, law))
                a.patch(patch, row(along), {state: radius * value for state, value in speed.items()}, law)
            pressed = row(normal, factor=-float(stiffness[i]))
            if damping[i]:
                pressed |= row(normal, "'", -float(damping[i]))
            a.normal(name, patch, pressed, row(normal), opens=contact.opens)
            of_points[f"normal_force_of_{name}"] = Output({f"N:{name}": 1.0}, "N", _OF_POINTS[0])
            of_points[f"slip_speed_of_{name}"] = Output({f"w:{patch}": 1.0}, "m/s", _OF_POINTS[1])
        of_contact = {f"N:{entry[0]}": 1.0 for entry in a.normals[-len(points.area) :]}
        a.outputs[f"normal_force_{points.name}"] = Output(of_contact, "N", Plot())
    if _as_film(a, p):
        _add_film(a, p, model, springs, dampers, speed)
        return
    first = patches[0].patch
    a.outputs |= of_points
    a.outputs |= {
        "normal_force": Output({f"N:{name}": 1.0 for name, *_ in a.normals}, "N"),
        "friction_force": Output({f"T:{name}": 1.0 for name, *_ in a.patches}, "N"),
        "slip_speed": Output({f"w:{first}": 1.0}, "m/s", Plot()),
        "surface_speed": Output(dict(a.surface(first)), "m/s", role="drive"),
    }
    a.judges.append(partial(tension, p.stated))


def _as_film(a: Assembly, p: Tables) -> bool:
    """Whether the contacts run as points of a film. Raises SceneError if they are to, but cannot."""
    laws = [p.law_of(name) for name in p.contacts]
    asked = p.structure.film
    wrong = [
        f"contacts.{name}.opens: points of a film open; leave it out" for name, c in p.contacts.items() if not c.opens
    ]
    if any(law.states or law.backward is not None for law in laws):
        wrong.append("friction.law: points of a film support no law with memory or with a direction")
    damped = []
    for name in p.contacts:
        contact = p.of_stiffness(name)
        if contact.damping or contact.damper:
            damped.append(name)
    if damped and (wrong or asked is False):
        remedy = "leave it out, or make them a film"
        wrong += [f"contacts.{name}: only points of a film have damping; {remedy}" for name in damped]
    if wrong and (asked or damped):
        raise SceneError("structure.film", wrong)
    if wrong or asked is not None:
        return not wrong and bool(asked)
    mode_sets = 3 ** len(a.patches) * 2 ** len(a.normals)
    return bool(damped) or mode_sets > CROWD


def _add_film(a: Assembly, p: Parameters, model: Full, springs: list[Array], dampers: list[Array], speed: Row) -> None:
    """Make the contacts points of a film, with outputs of each point.

    Without `shear` a point is as stiff along the sliding as across it. The slip speed of a point is that between the
    surface and the tip of its shear spring, 0 in stick; the relative speed is that between surface and structure.
    """
    a.signal("slid", dict(speed), 0.0, "drive")
    coordinates = list(a.coordinates)
    passing: list[Row] = []
    shears = []
    for points, stiffness in zip(model.contacts, springs, strict=True):
        shear = p.of_stiffness(points.name).shear
        shears.append(stiffness if shear is None else shear * points.area)
        for radius, along in zip(points.radius.tolist(), points.along):
            relative = {state: radius * value for state, value in speed.items()}
            relative |= {f"{name}'": -value for name, value in zip(coordinates, along.tolist()) if value}
            passing.append(relative)
    names = [name for name, *_ in a.normals]
    laws = tuple(p.law_of(points.name) for points in model.contacts for _ in points.area)
    normals = np.concatenate([-points.normal for points in model.contacts])
    alongs = np.concatenate([points.along for points in model.contacts])
    places = np.concatenate([points.position for points in model.contacts])
    reach = np.concatenate([points.radius for points in model.contacts])
    radius_of_first = float(reach[0])
    a.film = Film(
        rows=np.stack([normals.T, alongs.T])[None],
        slid="slid",
        stiffness=np.concatenate(springs),
        shear=np.concatenate(shears),
        damping=np.concatenate(dampers),
        mu=np.array([law.static for law in laws]),
        reach=reach,
        x=places[:, 0].copy(),
        y=places[:, 1].copy(),
        laws=laws,
        tells=True,
    )
    first = 0
    for points in model.contacts:
        each = range(first, first + len(points.area))
        a.outputs[f"normal_force_{points.name}"] = Output({film.at("P", i): 1.0 for i in each}, "N", Plot())
        first += len(points.area)
    for i, name in enumerate(names):
        a.outputs[f"normal_force_of_{name}"] = Output({film.at("P", i): 1.0}, "N", _OF_POINTS[0])
        a.outputs[f"slip_speed_of_{name}"] = Output({film.at("w", i): 1.0}, "m/s", _OF_POINTS[1])
        a.outputs[f"relative_speed_of_{name}"] = Output(passing[i], "m/s", _RELATIVE, on_request=True)
        a.outputs[f"state_of_{name}"] = Output({film.at("s", i): 1.0}, "1", _OF_POINTS[2])
    a.outputs |= {
        "normal_force": Output({film.over("normal"): 1.0}, "N"),
        "friction_force": Output({film.over("friction"): 1.0}, "N"),
        "contact_fraction": Output({film.over("fraction"): 1.0}, "1", Plot(place=2)),
        "openings": Output({film.over("openings"): 1.0 / COUNTED}, "1", Plot()),
        "slip_speed": Output({film.at("w", 0): 1.0}, "m/s", Plot()),
        "surface_speed": Output(
            {state: radius_of_first * value for state, value in speed.items()}, "m/s", role="drive"
        ),
    }
    a.judges.append(partial(tension, p.stated))


def _doubts(doubts: tuple[Doubt, ...], system: System, step: float) -> Iterator[Finding]:
    """What may be wrong with the structure."""
    for what, remedy in doubts:
        yield Finding("warning", what, 0.0, remedy)


def _unheld(at: Steady, stated: Stated | None) -> str:
    """What nothing holds, in words: of a meshed structure the body or node set that moves most."""
    names = at.system.coordinates
    if at.unheld and stated is not None and stated.masses:
        count = len(names)
        loose = np.linalg.svd(at.A[count : 2 * count, :count])[2][-1]
        shares = stated.shares(dict(zip(names, loose.tolist())), {}, names)
        return f"no spring holds {next(iter(shares))}"
    return at.unheld.partition(";")[0]


def tension(stated: Stated | None, system: System, step: float) -> Iterator[Finding]:
    """What nothing holds, also with every contact open if none presses, and points that would have to pull."""
    if system.film is not None:  # its forces are those of the contacts already
        start = system.start.copy()
        start[[system.names.index(film.on(name)) for name in system.coordinates]] = 0.0
        system = replace(system, start=start)
    key = sliding_key(system)
    at = steady(system, key)
    apart = ""
    remedy = "hold it by a support or by a contact that presses"
    if not at.balanced:
        if unheld := _unheld(at, stated):
            yield Finding("error", unheld, 0.0, remedy)
        return
    forces = (at.modes.normal @ at.x + at.modes.normal_t @ at.T).tolist()
    pulls = sorted((force, normal.name) for force, normal in zip(forces, system.normals) if force <= 0.0)
    if pulls and len(pulls) == len(forces):
        slip, _, limiters, *_ = system.modes(key)
        lifted = [OPEN if k.opens else CLOSED for k in system.normals]
        apart = _unheld(steady(system, system.key(slip, lifted, limiters)), stated)
    if apart:
        yield Finding("error", f"no contact presses, and {apart}", 0.0, remedy)
    elif pulls:
        shown = ", ".join(f"{name} ({force:.3g} N)" for force, name in pulls[:4])
        more = f" and {len(pulls) - 4} more" if len(pulls) > 4 else ""
        what = f"{len(pulls)} of {len(forces)} contact points do not press at steady sliding: {shown}{more}"
        remedy = "more load, or a load nearer to these points; eigenvalues with every point closed do not hold there"
        yield Finding("warning", what, pulls[0][0], remedy)


def _range(key: str, value: float, parts: Iterable[Part]) -> tuple[float, float]:
    """The range of a number that multiplies parts: of one sign where a part is divided by it."""
    most = max(1e4, abs(value))
    if any(part.key == key and part.power < 0 for part in parts):
        return (1e-9, most) if value > 0.0 else (-most, -1e-9)
    return (0.0 if key == "load.force" else -most), most


def _sliding(a: Assembly, p: Tables, stiffness: Array, springs: list[Array], model: Full, pressed: Array) -> Array:
    """The coordinates [m] in steady sliding with every point closed under the forces `pressed` [N].

    The coefficient of a law with memory depends on the load of its patch, which is sought in rounds.
    """
    speed = p.drive.speed if p.drive else 0.0
    laws = [p.law_of(points.name) for points in model.contacts for _ in points.area]
    if laws:
        normals = np.concatenate([points.normal for points in model.contacts])
        alongs = np.concatenate([points.along for points in model.contacts])
        each = np.concatenate(springs)
    else:
        normals = alongs = np.zeros((0, len(stiffness)))
        each = np.zeros(0)
    slips = [radius * speed for points in model.contacts for radius in points.radius.tolist()]
    patches = [patch for _, patch, *_ in a.normals]
    loads = dict.fromkeys(patches, 0.0)
    for _ in range(_ROUNDS if any(law.states for law in laws) else 1):
        held = stiffness.copy()
        for law, slip, k, normal, along, patch in zip(laws, slips, each, normals, alongs, patches):
            mu = math.copysign(law.mu(abs(slip), loads[patch]), slip)
            held += k * np.outer(normal + mu * along, normal)
        q = np.linalg.lstsq(held, pressed, rcond=None)[0]
        before = loads
        loads = dict.fromkeys(patches, 0.0)
        forces = -each * (normals @ q)
        for patch, force in zip(patches, forces.tolist()):
            loads[patch] += max(force, 0.0)
        if all(abs(loads[patch] - before[patch]) <= _SETTLED * loads[patch] for patch in patches):
            break
    return np.asarray(q)


def _begin(
    a: Assembly, p: Tables, mass: Array, stiffness: Array, springs: list[Array], model: Full, pressing: Array
) -> None:
    """Write the start: steady sliding with every point closed, and the velocity of a blow on the point of the knock."""
    q = np.zeros(len(a.coordinates))
    if p.load is not None:
        sliding = _sliding(a, p, stiffness, springs, model, pressing * p.load.force)
        q = sliding if p.start.at == "sliding" else q
        if a.film is not None:
            pressed = a.film.stiffness * (sliding @ a.film.rows[0, 0])
            creep = a.film.creep(pressed)
            a.about["film"] = (
                "points that open, stick and slip one by one; a stuck one is held by its shear stiffness, "
                f"{creep * 1e6:.2g} um at the most at steady sliding before it slips"
            )
    struck = np.array([a.strike.get(name, 0.0) for name in a.coordinates])
    v = struck * 0.0
    if p.start.velocity:
        blow = np.linalg.solve(mass, struck)
        v = blow * (p.start.velocity / float(struck @ blow))
    a.start |= {name: value for name, value in zip(a.coordinates, q.tolist()) if value}
    a.start |= {f"{name}'": value for name, value in zip(a.coordinates, v.tolist()) if value}
