"""The result of a robust design: values with their tolerance, growth of the worst rig, and what limits it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rig.analysis.robust import in_time
from rig.analysis.robust.growth import LOOP, NoSliding
from rig.analysis.robust.in_time import Timed
from rig.analysis.robust.job import Job
from rig.analysis.robust.proof import PROVED, REFUTED, Certificate
from rig.analysis.robust.search import NOMINAL, ROBUST, SCENE, Entry, Findings, confidence
from rig.printable import counted
from rig.results import Column, Result, Table
from rig.scenes.belief import lines as belief_lines
from rig.scenes.left_out import left_out

_END = 1e-3  # of a range: nearer to an end, the range limits the design
_NEWS = 0.01  # of the box or of a growth: what differs by less is the same rig, or no worse
_LISTED = 5  # worst rigs
_DIGITS = ".10g"  # of designed values: the worst rig is steep in them
DESIGNED = "designed"
"""Origin of a value that a design has found."""


@dataclass(frozen=True)
class RobustResult(Result):
    """The result of `rig.optimise` against uncertain values. Printed, it is the report.

    `values`: the designed values (SI) by key. `worst`: growth [1/s] of the worst rig that was found; `factor`: of all
    ranges, or of one, that a tolerance allows (NaN: none was asked for).
    """

    FIGURE: ClassVar = "rig.analysis.robust.figures:robust_figure"

    job: Job
    found: Findings
    provenance: Mapping[str, str]
    folder: Path
    certificate: Certificate | None = None
    """Of the whole box, if it was asked for."""
    timed: tuple[Timed, ...] = ()
    """Runs of nominal and worst rigs, if a proof was asked for, and why there is none or not all of it."""
    untimed: str = ""

    @property
    def entries(self) -> dict[str, Entry]:
        """The designs by name: robust, nominal optimum, scene."""
        return {entry.name: entry for entry in self.found.entries}

    @property
    def values(self) -> dict[str, float]:
        """The designed values (SI) by key."""
        return self.job.box.design(self.found.design.x)

    @property
    def worst(self) -> float:
        """The largest growth [1/s] of any rig of the box that was found, with the designed values."""
        return float(max(self.found.design.worst.growth, self.found.audit.growth.max()))

    @property
    def factor(self) -> float:
        """The factor of the ranges that is held; NaN if no tolerance was asked for."""
        return self.found.factor

    @property
    def held(self) -> bool:
        """Whether the worst rig has a growth, and a tolerance was found if one was asked for."""
        return math.isfinite(self.worst) and not self.found.factor == 0.0

    @cached_property
    def tolerances(self) -> dict[str, str]:
        """The ranges of the uncertain values that the design is for, as texts by key."""
        ends = zip(self.job.box.uncertain, *self.found.region)
        return {value.key: value.text(float(low), float(high)) for value, low, high in ends}

    @property
    def growing(self) -> int:
        """How many rigs of the audit grow."""
        return int(np.sum(self.found.audit.growth > 0.0))

    def worst_values(self, entry: Entry, number: int = 0) -> dict[str, float]:
        """The uncertain values (SI) of a worst rig of a design by key."""
        return self.job.box.rig(self.job.box.design(entry.x), entry.worst.rigs[number])

    def shown(self) -> Iterator[str | Table]:
        """Yield the growth of the worst rig, the values, the designs beside each other, and what each value costs."""
        job = self.job
        yield self._headline()
        low, high = job.band
        band = f" between {low:g} and {high:g} Hz" if high < math.inf else ""
        rounds = counted(len(self.found.design.rounds), "round")
        yield f"  {job.measure}{band}, {counted(len(job.box.uncertain), 'uncertain value')}, {rounds}, seed {job.seed}"
        yield from (f"  {line}" for line in self._remarks())
        if job.box.free:
            yield ""
            yield self._values()
        yield ""
        yield self._designs()
        yield ""
        yield self._uncertain()
        yield ""
        yield self._rigs()
        yield ""
        if self.timed:
            yield in_time.table(self.timed)
            yield ""
        yield from (f"  {line}" for line in self._components())
        yield from (f"  {line}" for line in self._sure())
        yield from (f"  {line}" for line in self._proof())
        yield from (f"  {line}" for line in in_time.lines(self.timed))
        if self.untimed:
            yield f"  the proof in time is not complete: {self.untimed}"
        yield from (f"  {line}" for line in self._notes())

    def _headline(self) -> str:
        job = self.job
        bad = self.found.design.worst
        if bad.growth == -math.inf:
            return f"{job.scene.name}: no rig of the box has a mode in the band"
        if not math.isfinite(bad.growth):
            return f"{job.scene.name}: a rig of the box has no growth: {self._fault()}"
        if job.tolerance is None:
            where = f"at {bad.hertz:.5g} Hz{self._from_edge(bad.hertz)}"
            return f"{job.scene.name}: growth of the worst rig {bad.growth:.6g} 1/s {where}"
        wanted = f"decays with {job.decay:g} 1/s" if job.decay else "grows"
        none = "every rig" if job.decay else "no rig"
        if self.factor == 0.0:
            return f"{job.scene.name}: no design keeps the rule that {none} {wanted}, not even without this tolerance"
        i = job.number
        if i is None:
            return f"{job.scene.name}: {none} {wanted} up to {self.factor:.4g} times all ranges"
        value = job.box.uncertain[i]
        return f"{job.scene.name}: {none} {wanted} with {value.key} {self.tolerances[value.key]}"

    def _fault(self) -> str:
        """Why the worst rig has no growth, and which it is."""
        at = ", ".join(f"{key} = {value:.6g}" for key, value in self.worst_values(self.found.entries[0]).items())
        try:
            self.job.grown().matrix(self.found.design.x, self.found.design.worst.u)
        except NoSliding as fault:
            return f"{fault} ({at}); make the range smaller"
        return at

    def _from_edge(self, hertz: float) -> str:
        """How far a frequency is from the nearest edge of the band, in words."""
        edges = [edge for edge in self.job.band if 0.0 < edge < math.inf]
        if not edges:
            return ""
        edge = min(edges, key=lambda edge: abs(edge - hertz))
        return f", {100.0 * abs(hertz / edge - 1.0):.3g} % from the edge of the band at {edge:g} Hz"

    def _remarks(self) -> Iterator[str]:
        scene = self.job.scene
        yield from belief_lines(scene)
        if self.job.measure != LOOP:
            if text := left_out(scene):
                yield text
        elif not scene.redesign:
            keys = [value.key for value in self.job.box.uncertain if not value.key.startswith("controllers.")]
            if keys:
                yield f"controllers are not told {', '.join(keys)}: errors of the rig (--redesign tells them)"

    def _values(self) -> Table:
        numbers = [Column(name, digits=_DIGITS) for name in (DESIGNED, NOMINAL, SCENE)]
        columns = (Column("free"), *numbers, Column("unit"), Column("tolerance"), Column("note"))
        rows = []
        named = {entry.name: self.job.box.design(entry.x) for entry in self.found.entries}
        for axis, share in zip(self.job.box.free, self.found.design.x):
            at = [named[name][axis.key] / axis.scale if name in named else None for name in (ROBUST, NOMINAL, SCENE)]
            note = "at the end of its range: a wider one may hold a better design" if _ends(share) else ""
            unit = "" if axis.shown == "1" else axis.shown
            rows.append((axis.key, *at, unit, self.tolerances.get(axis.key, ""), note))
        return Table("values", columns, rows)

    def _designs(self) -> Table:
        growths = (Column("growth of the nominal rig", "1/s", ".6g"), Column("at", "Hz", ".5g"))
        worst = (Column("of the worst rig", "1/s", ".6g"), Column("worst at", "Hz", ".5g"))
        rows = []
        for entry in self.found.entries:
            name = entry.name if self.job.box.free else SCENE
            rows.append((name, *map(_finite, (*entry.nominal, entry.worst.growth, entry.worst.hertz))))
        return Table("designs", (Column("design"), *growths, *worst), rows)

    def _uncertain(self) -> Table:
        columns = (
            Column("uncertain"),
            Column("range"),
            Column("at the worst rig", digits=".6g"),
            Column("unit"),
            Column("influence", "1/s", ".4g"),
            Column("one percent more", "1/s", ".4g"),
        )
        values = self.worst_values(self.found.entries[0])
        rows = []
        for value, relief, percent in zip(self.job.box.uncertain, self.found.relief, self.found.percent):
            unit = "" if value.axis.shown == "1" else value.axis.shown
            at = values[value.key] / value.axis.scale
            rows.append((value.key, self.tolerances[value.key], at, unit, *map(_finite, (relief, percent))))
        return Table("uncertain", columns, rows)

    def _rigs(self) -> Table:
        bad = self.found.design.worst
        keys = [Column(value.key, value.axis.unit, ".6g") for value in self.job.box.uncertain]
        columns = (Column("worst rigs", digits=".0f"), *keys, Column("growth", "1/s", ".6g"), Column("at", "Hz", ".5g"))
        rows: list[tuple[Any, ...]] = []
        seen: list[Any] = []
        for number, u in enumerate(bad.rigs[:_LISTED]):
            if any(np.abs(u - other).max() < _NEWS for other in seen):
                continue
            seen.append(u)
            at = self.worst_values(self.found.entries[0], number)
            ends = map(_finite, (float(bad.growths[number]), float(bad.tones[number])))
            rows.append((len(rows) + 1, *at.values(), *ends))
        return Table("rigs", columns, rows)

    def _components(self) -> Iterator[str]:
        """What rounding to a series has done."""
        rounded = self.found.rounded
        if rounded is None:
            return
        before = self.job.box.design(rounded.before)
        chosen = self.values
        for axis in self.job.box.free:
            if before[axis.key] != chosen[axis.key]:
                was = f"{before[axis.key] / axis.scale:.6g} {axis.shown}"
                yield f"series {rounded.series}: {axis.key} {axis.text(chosen[axis.key])} in place of {was}"
        bad = rounded.worst.growth
        yield f"series {rounded.series}: worst rig {bad:.5g} 1/s, with any values {rounded.growth:.5g} 1/s"
        if bad > self.job.target:
            yield (
                f"no values of series {rounded.series} near the design hold: of {rounded.tried} combinations the best "
                "is this one; take a finer series, or trim a component"
            )

    def _proof(self) -> Iterator[str]:
        """What is known of the whole box."""
        certificate = self.certificate
        if certificate is None:
            return
        limit = f"no rig of the box grows by more than {certificate.limit:g} 1/s"
        what = limit if certificate.limit else "no rig of the box grows"
        boxes = counted(certificate.boxes, "part")
        if any(value.step for value in self.job.box.uncertain):
            boxes += ", every delay of whole frames among them"
        if certificate.verdict == PROVED:
            yield f"proved: {what} (the box in {boxes})"
            yield (
                f"  it rests on the matrix as a polynomial of degree {certificate.degree}, error "
                f"{certificate.error:.1e} of its largest entry"
            )
        elif certificate.verdict == REFUTED and certificate.rig is not None:
            rig = self.job.box.rig(self.values, certificate.rig)
            at = ", ".join(f"{key} = {value:.6g}" for key, value in rig.items())
            yield f"not proved that {what}: refuted by the rig {at}"
        else:
            why = certificate.why or (
                f"{100.0 * certificate.share:.3g} % of the box is proved, "
                f"{counted(certificate.left, 'part')} of it left after {boxes}"
            )
            yield f"undecided whether {what}: {why}"

    def _sure(self) -> Iterator[str]:
        """What the audit says."""
        growth = self.found.audit.growth
        count = len(growth)
        worse = int(np.sum(growth > self.found.design.worst.growth * (1.0 + math.copysign(_NEWS, self.worst))))
        largest = _text(float(growth.max()))
        yield f"audit: {self.growing} of {count} random rigs grow; the worst of them with {largest} 1/s"
        if not worse:
            share = 100.0 * confidence(count)
            yield f"none is worse than stated: with 99.9 % confidence less than {share:.2g} % of all rigs are"
        else:
            yield f"{worse} are worse than stated: a longer search is needed; run it with another --seed"
        if len(self.found.beside):
            grow = int(np.sum(self.found.beside > 0.0))
            largest = _text(float(self.found.beside.max()))
            yield f"with the nominal optimum {grow} of them grow, the worst with {largest} 1/s"

    def _notes(self) -> Iterator[str]:
        """What its user should know of the design."""
        if not self.found.design.settled and self.job.tolerance is None:
            yield "not settled: the last worst rig found is worse than the rigs before; another --seed may end it"
        for key in self.found.idle:
            yield f"{key} has no influence on any mode that counts: leave it out"
        if math.isfinite(self.found.stuck):
            hertz = self.found.stuck
            yield f"the mode at {hertz:.5g} Hz limits every design, and no free value moves it: --band leaves it out"
        if self.found.edges:
            tones = ", ".join(f"{hertz:g}" for hertz in self.found.edges)
            yield f"modes at {tones} Hz are within 2 % of an edge of the band, at which the growth jumps"

    def listed(self) -> Table:
        """Return a row for each rig of the audit: uncertain values (SI) and growth with the designs."""
        found = self.found
        box = self.job.box
        keys = [Column(value.key, value.axis.unit, ".6g") for value in box.uncertain]
        names = [ROBUST if box.free else SCENE, *([NOMINAL] if len(found.beside) else [])]
        columns = (*keys, *(Column(f"growth, {name}", "1/s", ".6g") for name in names), Column("at", "Hz", ".5g"))
        rows = []
        for k, u in enumerate(found.audit.u):
            growths = [found.audit.growth[k], *found.beside[k : k + 1]]
            at = box.rig(self.values, u)
            rows.append((*at.values(), *map(_finite, growths), _finite(found.audit.hertz[k])))
        return Table("audit", columns, rows)

    def facts(self) -> dict[str, Any]:
        """Return the designed values, their growth, and the audit; values in SI."""
        job = self.job
        found = self.found
        growth = found.audit.growth
        return {
            "scene": job.scene.name,
            "measure": job.measure,
            "band": [_finite(edge) for edge in job.band],
            "limits": [limit.text for limit in job.limits],
            "decay": job.decay,
            "seed": job.seed,
            "parameters": self.values,
            "ranges": {axis.key: list(axis.values) for axis in job.box.free},
            "tolerances": self.tolerances,
            "worst": _finite(self.worst),
            "worst_rig": self.worst_values(found.entries[0]),
            "factor": _finite(found.factor),
            "settled": found.design.settled,
            "rounds": [list(map(_finite, each)) for each in found.design.rounds],
            "evaluations": found.assembled,
            "audit": {
                "rigs": len(growth),
                "growing": self.growing,
                "worst": _finite(float(growth.max())),
                "share_that_can_be_worse": confidence(len(growth)),
            },
            "series": self._rounded_facts(),
            "certificate": self._certificate_facts(),
            "in_time": in_time.facts(self.timed),
            "not_in_time": self.untimed,
            "without_influence": list(found.idle),
            "at_the_edge": list(found.edges),
            "belief": list(self._remarks()),
            "folder": str(self.folder),
        }

    def _rounded_facts(self) -> dict[str, Any] | None:
        rounded = self.found.rounded
        if rounded is None:
            return None
        return {
            "name": rounded.series,
            "before": self.job.box.design(rounded.before),
            "worst_before": _finite(rounded.growth),
            "worst": _finite(rounded.worst.growth),
            "tried": rounded.tried,
            "holds": bool(rounded.worst.growth <= self.job.target),
        }

    def _certificate_facts(self) -> dict[str, Any] | None:
        certificate = self.certificate
        if certificate is None:
            return None
        facts = asdict(certificate)
        facts["rig"] = None if certificate.rig is None else self.job.box.rig(self.values, certificate.rig)
        return facts


def _ends(share: float) -> bool:
    return min(share, 1.0 - share) < _END


def _finite(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _text(growth: float) -> str:
    return f"{growth:.5g}" if math.isfinite(growth) else "no growth at all (no steady sliding)"
