"""The result of a robust design: values with their tolerance, growth of the worst rig, and what limits it.

And the scene that it writes: based on the old one, with the designed values only, and the origin "designed".
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rig.analysis.identification.written import base_of, stated, text_of
from rig.analysis.robust import in_time
from rig.analysis.robust.box import values_text
from rig.analysis.robust.growth import LOOP
from rig.analysis.robust.in_time import Timed
from rig.analysis.robust.search import NOMINAL, PROVED, ROBUST, SCENE, Certificate, Entry, Findings
from rig.analysis.robust.stated import Job
from rig.errors import UsageError
from rig.machine.files import write_file
from rig.printable import counted
from rig.results import Column, Result, Table, plain
from rig.scenes.belief import lines as belief_lines
from rig.scenes.left_out import left_out

_END = 1e-3  # of a range: nearer to an end, the range limits the design
_NEWS = 0.01  # of the box or of a growth: what differs by less is the same rig, or no worse
_LISTED = 5  # worst rigs
_SURE = math.log(1000.0)  # over the number of random rigs: the share that can be worse, with 99.9 % confidence
_DIGITS = ".10g"  # of designed values: the worst rig is steep in them
_GROWTH = Column("growth", "1/s", ".6g")
_AT = Column("at", "Hz", ".5g")
NOTHING_DESIGNED = "no scene is written: no value is free, so that nothing is designed; free one with --over"
DESIGNED = "designed"
"""Origin of a value that a design has found."""


@dataclass(frozen=True)
class RobustResult(Result):
    """The result of `rig.optimise` against uncertain values. Printed, it is the report.

    `values`: the designed values (SI) by key. `worst`: growth [1/s] of the worst rig that was found; `factor`: of all
    ranges, or of one, that a tolerance allows (NaN: none was asked for). `certificate`: of the whole box, and `timed`:
    runs of nominal and worst rigs, if a proof was asked for; `untimed`: why these are not complete.
    """

    FIGURE: ClassVar = "rig.analysis.robust.figures:robust_figure"

    job: Job
    found: Findings
    provenance: Mapping[str, str]
    folder: Path
    certificate: Certificate | None = None
    timed: tuple[Timed, ...] = ()
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
        return float(max(self.found.design.growth, self.found.audit.growth.max()))

    @property
    def factor(self) -> float:
        """The factor of the ranges that is held; NaN if no tolerance was asked for."""
        return self.found.factor

    @property
    def held(self) -> bool:
        """Whether the worst rig has a growth, and a tolerance was found if one was asked for."""
        return math.isfinite(self.worst) and not self.factor == 0.0

    @cached_property
    def tolerances(self) -> dict[str, str]:
        """The ranges of the uncertain values that the design is for, as texts by key."""
        ends = zip(self.job.box.uncertain, *self.found.region)
        return {value.key: value.text(float(low), float(high)) for value, low, high in ends}

    @property
    def growths(self) -> dict[str, Any]:
        """The growth [1/s] of the rigs of the audit [rig], by design."""
        growths = {ROBUST if self.job.box.free else SCENE: self.found.audit.growth, NOMINAL: self.found.beside}
        return {name: growth for name, growth in growths.items() if len(growth)}

    @property
    def growing(self) -> int:
        """How many rigs of the audit grow."""
        return int(np.sum(self.found.audit.growth > 0.0))

    def rig(self, u: Iterable[float]) -> dict[str, float]:
        """The uncertain values (SI) of a rig of the design by key."""
        return self.job.box.rig(self.values, [*u])

    def shown(self) -> Iterator[str | Table]:
        """Yield the growth of the worst rig, the values, the designs beside each other, and what each value costs."""
        yield self._headline()
        yield from (f"  {line}" for line in self._asked())
        tables = [self._values(), self._designs(), self._uncertain(), self._rigs()]
        for table in tables if self.job.box.free else tables[1:]:
            yield from ("", table)
        yield ""
        if self.timed:
            yield from (in_time.table(self.timed), "")
        said = (self._components(), self._sure(), self._proof(), in_time.lines(self.timed), self._notes())
        for lines in said:
            yield from (f"  {line}" for line in lines)

    def _headline(self) -> str:
        job = self.job
        bad = self.found.design.worst
        name = job.scene.name
        if bad.growth[0] == -math.inf:
            return f"{name}: no rig of the box has a mode in the band"
        if not math.isfinite(bad.growth[0]):
            return f"{name}: a rig of the box has no growth: {self._fault()}"
        if job.tolerance is None:
            where = f"at {bad.hertz[0]:.5g} Hz{self._from_edge(bad.hertz[0])}"
            return f"{name}: growth of the worst rig {bad.growth[0]:.6g} 1/s {where}"
        holds = f"every rig decays with {job.decay:g} 1/s" if job.decay else "no rig grows"
        if self.factor == 0.0:
            return f"{name}: no design keeps the rule that {holds}, not even without this tolerance"
        if not job.tolerance:
            return f"{name}: {holds} up to {self.factor:.4g} times all ranges"
        return f"{name}: {holds} with {job.tolerance} {self.tolerances[job.tolerance]}"

    def _fault(self) -> str:
        """Why the worst rig has no growth, and which it is."""
        u = self.found.design.worst.u[0]
        why = self.job.grown().matrix(self.found.design.x, u).why
        return f"{why} ({values_text(self.rig(u))}); make the range smaller"

    def _from_edge(self, hertz: float) -> str:
        """How far a frequency is from the nearest edge of the band, in words."""
        edges = [edge for edge in self.job.band if 0.0 < edge < math.inf]
        edge = min(edges, key=lambda edge: abs(edge - hertz), default=0.0)
        away = f"{100.0 * abs(hertz / edge - 1.0):.3g} % from the edge" if edges else ""
        return f", {away} of the band at {edge:g} Hz" if edges else ""

    def _asked(self) -> Iterator[str]:
        """What was asked for, and what controllers are told."""
        job = self.job
        low, high = job.band
        band = f" between {low:g} and {high:g} Hz" if high < math.inf else ""
        rounds = counted(len(self.found.design.rounds), "round")
        yield f"{job.measure}{band}, {counted(len(job.box.uncertain), 'uncertain value')}, {rounds}, seed {job.seed}"
        yield from self._belief()

    def _belief(self) -> Iterator[str]:
        scene = self.job.scene
        yield from belief_lines(scene)
        if self.job.measure != LOOP:
            yield from filter(None, [left_out(scene)])
            return
        keys = [key for key in self.job.box.keys if not key.startswith("controllers.")]
        if keys and not scene.redesign:
            yield f"controllers are not told {', '.join(keys)}: errors of the rig (--redesign tells them)"

    def _values(self) -> Table:
        numbers = [Column(name, digits=_DIGITS) for name in (DESIGNED, NOMINAL, SCENE)]
        columns = (Column("free"), *numbers, Column("unit"), Column("tolerance"), Column("note"))
        rows = []
        named = {entry.name: self.job.box.design(entry.x) for entry in self.found.entries}
        for axis, share in zip(self.job.box.free, self.found.design.x):
            at = [named.get(name, {}).get(axis.key, math.nan) / axis.scale for name in (ROBUST, NOMINAL, SCENE)]
            ends = "at the end of its range: a wider one may hold a better design"
            note = ends if min(share, 1.0 - share) < _END else ""
            rows.append((axis.key, *at, axis.shown_unit, self.tolerances.get(axis.key, ""), note))
        return Table("values", columns, plain(rows))

    def _designs(self) -> Table:
        growths = (Column("growth of the nominal rig", "1/s", ".6g"), _AT)
        worst = (Column("of the worst rig", "1/s", ".6g"), Column("worst at", "Hz", ".5g"))
        rows = []
        for entry in self.found.entries:
            name = entry.name if self.job.box.free else SCENE
            rows.append((name, *entry.nominal, entry.worst.growth[0], entry.worst.hertz[0]))
        return Table("designs", (Column("design"), *growths, *worst), plain(rows))

    def _uncertain(self) -> Table:
        at = Column("at the worst rig", digits=".6g")
        costs = [Column(name, "1/s", ".4g") for name in ("influence", "one percent more")]
        values = self.rig(self.found.design.worst.u[0])
        rows = []
        for value, *cost in zip(self.job.box.uncertain, self.found.relief, self.found.percent):
            axis = value.axis
            rows.append((axis.key, self.tolerances[axis.key], values[axis.key] / axis.scale, axis.shown_unit, *cost))
        return Table("uncertain", (Column("uncertain"), Column("range"), at, Column("unit"), *costs), plain(rows))

    def _keys(self) -> list[Column]:
        return [Column(value.key, value.axis.unit, ".6g") for value in self.job.box.uncertain]

    def _rigs(self) -> Table:
        bad = self.found.design.worst
        news: list[int] = []
        for k, u in enumerate(bad.u[:_LISTED]):
            if all(np.abs(u - bad.u[other]).max() >= _NEWS for other in news):
                news.append(k)
        rows = [(number, *self.rig(bad.u[k]).values(), bad.growth[k], bad.hertz[k]) for number, k in enumerate(news, 1)]
        return Table("rigs", (Column("worst rigs", digits=".0f"), *self._keys(), _GROWTH, _AT), plain(rows))

    def _components(self) -> Iterator[str]:
        """What rounding to a series has done."""
        before = self.found.unrounded
        if before is None:
            return
        series = f"series {self.job.series}"
        was = self.job.box.design(before.x)
        for axis in self.job.box.free:
            if was[axis.key] != self.values[axis.key]:
                yield f"{series}: {axis.key} {axis.text(self.values[axis.key])} in place of {axis.text(was[axis.key])}"
        bad = self.found.design.growth
        yield f"{series}: worst rig {bad:.5g} 1/s, with any values {before.growth:.5g} 1/s"
        if bad > self.job.target:
            yield (
                f"no values of {series} near the design hold: of {self.found.combinations} combinations the best "
                "is this one; take a finer series, or trim a component"
            )

    def _proof(self) -> Iterator[str]:
        """What is known of the whole box."""
        known = self.certificate
        if known is None:
            return
        what = f"no rig of the box grows by more than {known.limit:g} 1/s" if known.limit else "no rig of the box grows"
        parts = counted(known.boxes, "part")
        if any(value.step for value in self.job.box.uncertain):
            parts += ", every delay of whole frames among them"
        if known.verdict == PROVED:
            yield f"proved: {what} (the box in {parts})"
            of = f"a polynomial of degree {known.degree}, error {known.error:.1e} of its largest entry"
            yield f"  it rests on the matrix as {of}"
        elif known.rig is not None:
            yield f"not proved that {what}: refuted by the rig {values_text(self.rig(known.rig))}"
        else:
            left = f"{counted(known.left, 'part')} of it left after {parts}"
            why = known.why or f"{100.0 * known.share:.3g} % of the box is proved, {left}"
            yield f"undecided whether {what}: {why}"

    def _sure(self) -> Iterator[str]:
        """What the audit says."""
        growth = self.found.audit.growth
        worse = int(np.sum(growth > self.found.design.growth * (1.0 + math.copysign(_NEWS, self.worst))))
        yield f"audit: {self.growing} of {len(growth)} random rigs grow; the worst of them with {_text(growth)}"
        if worse:
            yield f"{worse} are worse than stated: a longer search is needed; run it with another --seed"
        else:
            share = 100.0 * _SURE / len(growth)
            yield f"none is worse than stated: with 99.9 % confidence less than {share:.2g} % of all rigs are"
        beside = self.found.beside
        if len(beside):
            grow = int(np.sum(beside > 0.0))
            yield f"with the nominal optimum {grow} of them grow, the worst with {_text(beside)}"

    def _notes(self) -> Iterator[str]:
        """What its user should know of the design."""
        found = self.found
        if self.untimed:
            yield f"the proof in time is not complete: {self.untimed}"
        if not found.design.settled and self.job.tolerance is None:
            yield "not settled: the last worst rig found is worse than the rigs before; another --seed may end it"
        for key in found.idle:
            yield f"{key} has no influence on any mode that counts: leave it out"
        if math.isfinite(found.stuck):
            hertz = found.stuck
            yield f"the mode at {hertz:.5g} Hz limits every design, and no free value moves it: --band leaves it out"
        if found.edges:
            tones = ", ".join(f"{hertz:g}" for hertz in found.edges)
            yield f"modes at {tones} Hz are within 2 % of an edge of the band, at which the growth jumps"

    def listed(self) -> Table:
        """Return a row for each rig of the audit: uncertain values (SI) and growth with the designs."""
        audit = self.found.audit
        columns = (*self._keys(), *(Column(f"growth, {name}", "1/s", ".6g") for name in self.growths), _AT)
        numbers = zip(audit.u, *self.growths.values(), audit.hertz)
        return Table("audit", columns, plain([(*self.rig(u).values(), *each) for u, *each in numbers]))

    def facts(self) -> dict[str, Any]:
        """Return the designed values, their growth, and the audit; values in SI."""
        job = self.job
        found = self.found
        growth = found.audit.growth
        return {
            "scene": job.scene.name,
            "measure": job.measure,
            "band": job.band,
            "limits": [limit.text for limit in job.limits],
            "decay": job.decay,
            "seed": job.seed,
            "parameters": self.values,
            "ranges": {axis.key: axis.values for axis in job.box.free},
            "tolerances": self.tolerances,
            "worst": self.worst,
            "worst_rig": self.rig(found.design.worst.u[0]),
            "factor": found.factor,
            "settled": found.design.settled,
            "rounds": np.array(found.design.rounds),
            "evaluations": found.assembled,
            "audit": {
                "rigs": len(growth),
                "growing": self.growing,
                "worst": growth.max(),
                "share_that_can_be_worse": _SURE / len(growth),
            },
            "series": self._series_facts(),
            "certificate": self._certificate_facts(),
            "in_time": in_time.facts(self.timed),
            "not_in_time": self.untimed,
            "without_influence": found.idle,
            "at_the_edge": found.edges,
            "belief": [*self._belief()],
            "folder": str(self.folder),
        }

    def _series_facts(self) -> dict[str, Any] | None:
        before = self.found.unrounded
        if before is None:
            return None
        return {
            "name": self.job.series,
            "before": self.job.box.design(before.x),
            "worst_before": before.growth,
            "worst": self.found.design.growth,
            "tried": self.found.combinations,
            "holds": self.found.design.growth <= self.job.target,
        }

    def _certificate_facts(self) -> dict[str, Any] | None:
        known = self.certificate
        if known is None:
            return None
        return asdict(known) | {"rig": None if known.rig is None else self.rig(known.rig)}

    def to_json(self) -> dict[str, Any]:
        """Return facts and records; growths that are not finite are None."""
        content: dict[str, Any] = plain(super().to_json())
        return content


def _text(growths: Any) -> str:
    """The largest growth as text."""
    largest = growths.max()
    return f"{largest:.5g} 1/s" if math.isfinite(largest) else "no growth at all (no steady sliding) 1/s"


def write(result: RobustResult, out: Path, based_on: str) -> Path:
    """Write the designed scene `out`, based on the scene with this name or file, and return its path.

    Raises UsageError if nothing is designed, OutputError if the file cannot be written.
    """
    if not result.job.box.free:
        raise UsageError(f"{out}: {NOTHING_DESIGNED}")
    write_file(out, scene_text(result, base_of(based_on, out)).encode())
    return out


def scene_text(result: RobustResult, based_on: str) -> str:
    """Return the text of the designed scene, whose notes have its margins, which rig explain shows."""
    job = result.job
    today = datetime.now(UTC).date().isoformat()
    against = ", ".join(f"{key} {tolerance}" for key, tolerance in result.tolerances.items())
    about = [
        f"Values that rig optimise designed on {today} against {against}.",
        f"{job.measure}: the worst rig found grows with {result.worst:.6g} 1/s, of {result.found.assembled} rigs.",
    ]
    lines: dict[str, str] = {}
    for key, (value, unit) in job.scene.values().items():  # what -p has changed belongs to the scene that was designed
        if key in job.scene.origins and job.scene.origins[key].origin == "user" and key not in result.values:
            text = value if isinstance(value, bool) or unit in ("", "1") else f"{value} {unit}"
            lines[key] = f'[{json.dumps(text)}, "user"]'
    nominal = result.found.entries[0].nominal[0]
    margins = f"growth of the nominal rig {nominal:.5g} 1/s, of the worst one {result.worst:.5g} 1/s"
    margins += f"; {result.growing} of {len(result.found.audit.growth)} random rigs grow"
    if result.certificate is not None and result.certificate.verdict == PROVED:
        margins += "; no rig of the box grows (proved)"
    for axis in job.box.free:
        tolerance = f", tolerance {result.tolerances[axis.key]}" if axis.key in result.tolerances else ""
        note = f"rig optimise, {today}{tolerance}; {margins}"
        lines[axis.key] = stated(repr(result.values[axis.key]), axis.unit, DESIGNED, note)
    return text_of(about, based_on, f"{job.scene.title}, designed", lines)
