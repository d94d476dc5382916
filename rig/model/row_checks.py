"""Checks the rows of a rig with a foreign plant or effect: names, units, numbers.

Rows of shipped plants are not checked, because they are right and are built often.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from math import isfinite, isnan
from typing import Any, get_args

import numpy as np

from rig.model.assembly import Assembly, Input, Output, Role
from rig.model.friction_law import Law
from rig.model.named_rows import Block
from rig.picture import Plot
from rig.units import brief, unit_fault

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")
"""A name of an output that a recording can hold."""


def name_fault(name: Any) -> str:
    """What is wrong with the name of an output or an actuator, in words; "" for one that a recording can hold."""
    if isinstance(name, str) and _NAME.fullmatch(name):
        return ""
    return f"{brief(name)} cannot be recorded; expected 1 to 64 letters, digits, '_', '.', '-'"


def faults(a: Assembly) -> Iterator[str]:
    """Yield the faults of a rig that cannot be computed, one line each: unknown names, numbers that are not finite."""
    unnamed = [what for what in ("outputs", "inputs", "start") if not isinstance(getattr(a, what), dict)]
    yield from (f"{what} is {brief(getattr(a, what))}; expected a dict, by name" for what in unnamed)
    if unnamed:
        return
    if strange := [*_strange_names(a)]:
        yield from strange
        return
    coordinates = set(a.coordinates)
    states = {*a.names}
    if not coordinates:
        yield "the rig has no coordinate; expected one at least, a.coordinate(name, mass)"
    blocks = {name for block in a.blocks for name in block.names}
    yield from (f"coordinate {c!r} has no mass" for c in a.coordinates if (c, c) not in a.mass and c not in blocks)
    for block in a.blocks:
        for what, matrix in zip(Block._fields[1:], block[1:]):
            for i, j in np.argwhere(~np.isfinite(matrix))[:1].tolist():
                at = f"{what}[{block.names[i]!r}, {block.names[j]!r}]"
                yield f"{at} contains {brief(float(matrix[i, j]))}; expected a finite number"
    products = {*a.products}
    contacts = [entry[0] for entry in a.patches]
    normals = [entry[0] for entry in a.normals]
    for what, names in (("friction contact", contacts), ("normal force", normals)):
        repeated = {name for name in names if names.count(name) > 1}
        yield from (f"two are called {what} {name!r}" for name in sorted(repeated))
    for what, entries in (("mass", a.mass), ("damping", a.damping), ("stiffness", a.stiffness)):
        for (i, j), value in entries.items():
            yield from _row(f"{what}[{i!r}, {j!r}]", dict.fromkeys({i, j} - coordinates or {i}, value), coordinates)
    for coordinate, row in a.force.items():
        yield from _row(f"force on {coordinate!r}", row, states | products)
        if coordinate not in coordinates:
            yield f"a force acts on {coordinate!r}, {_near(coordinates)}"
    for name, row in a.signals.items():
        yield from _row(f"rate of {name!r}", row, states | products)
    yield from (f"start of {line}" for name, value in a.start.items() for line in _entry(name, value, states))
    for name, direction, surface, law, travel in a.patches:
        yield from _row(f"direction of contact {name!r}", {**direction, **(travel or {})}, coordinates)
        yield from _row(f"surface speed of contact {name!r}", surface, states | products)
        if not isinstance(law, Law):
            yield f"contact {name!r} has {brief(law)} as its friction law"
    for name, patch, row, direction, inertia, _ in a.normals:
        yield from _row(f"normal force {name!r}", row, states | products)
        yield from _row(f"direction of normal force {name!r}", {**direction, **inertia}, coordinates)
        if patch not in contacts:
            yield f"normal force {name!r} is of contact {patch!r}, {_near(contacts)}"
    if a.film is not None and a.film.rows.shape[2] != len(a.coordinates):
        yield f"the rows of the film are over {a.film.rows.shape[2]} coordinates; the rig has {len(a.coordinates)}"
        return
    of_film = set(a.film.states(a.coordinates)) if a.film is not None else set()
    yield from _outputs(a, states | products | of_film, contacts, normals)


def _strange_names(a: Assembly) -> Iterator[str]:
    """Names that a recording cannot hold, and names that are no texts."""
    for what, names in (("output", a.outputs), ("input", a.inputs)):
        yield from (f"{what}: {fault}" for name in names if (fault := name_fault(name)))
    contacts = [entry[0] for entry in a.patches]
    normals = [entry[0] for entry in a.normals]
    for what, others in (("friction contact", contacts), ("normal force", normals), ("state", a.names)):
        yield from (
            f"{what}: {brief(name)} is no name; expected a text" for name in others if not isinstance(name, str)
        )


def _outputs(a: Assembly, known: set[str], contacts: Collection[str], normals: Collection[str]) -> Iterator[str]:
    rates = {f"{name}'" for name in (*a.network, *a.signals)} | {f"{name}''" for name in a.coordinates}
    forces = {f"{letter}:{name}" for letter in "Tw" for name in contacts} | {f"N:{name}" for name in normals}
    limited = {f"c:{entry[0]}" for entry in a.limiters}
    for name, output in a.outputs.items():
        if isinstance(output, Output):
            yield from _row(f"output {name!r}", output.row, known | rates | forces | limited)
            if fault := unit_fault(output.unit):
                yield f"unit of output {name!r}: {fault}"
            if output.role not in get_args(Role):
                yield f"output {name!r} has the role {brief(output.role)}; known: {', '.join(get_args(Role)[1:])}"
            if output.plot is not None and not isinstance(output.plot, Plot):
                yield f"output {name!r} has the plot {brief(output.plot)}; expected a rig.picture.Plot"
            elif output.plot is not None:
                described = isinstance(output.plot.title, str) and isinstance(output.plot.place, int)
                if not described:
                    yield f"output {name!r} has the plot {brief(output.plot)}; expected a text and a whole number"
        else:
            yield f"output {name!r} is {brief(output)}; expected a rig.model.assembly.Output"
    for name, actuator in a.inputs.items():
        if not isinstance(actuator, Input):
            yield f"input {name!r} is {brief(actuator)}; expected a rig.model.assembly.Input"
            continue
        if fault := unit_fault(actuator.unit):
            yield f"unit of input {name!r}: {fault}"
        numbers = (actuator.low, actuator.value, actuator.high, actuator.safe)
        if not all(isinstance(number, int | float) and not isnan(number) for number in numbers):
            yield f"input {name!r} has the numbers {brief(numbers)} (low, value, high, safe); expected four numbers"
        elif not actuator.low <= actuator.value <= actuator.high:
            span = f"{actuator.low:g} to {actuator.high:g} {actuator.unit}"
            yield f"input {name!r} begins with {actuator.value:g}, outside its range {span}"
        named = {state for state in (actuator.state, actuator.slope, actuator.lagging) if state} - set(a.names)
        yield from (f"input {name!r} names the state {state!r}, {_near(a.names)}" for state in sorted(named))


def _row(what: str, row: Mapping[str, Any], known: Collection[str]) -> Iterator[str]:
    if not isinstance(row, Mapping):
        yield f"{what} is {brief(row)}; expected a dict of numbers by name"
        return
    for name, value in row.items():
        if name not in known:
            yield f"{what} names {name!r}, {_near(known)}"
        elif not isinstance(value, int | float) or not isfinite(value):
            yield f"{what} contains {brief(value)}; expected a finite number"


def _entry(name: str, value: Any, known: Collection[str]) -> Iterator[str]:
    """Faults of the value of a state."""
    if name not in known:
        yield f"{name!r}, {_near(known)}"
    elif not isinstance(value, int | float) or not isfinite(value):
        yield f"{name!r} is {brief(value)}; expected a finite number"


def _near(known: Collection[str]) -> str:
    return f"which does not exist; known: {', '.join(sorted(known)) or 'none'}"
