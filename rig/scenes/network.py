"""The section [network] of a scene: links between plant and controllers that are made worse on purpose.

    [network.meas.vibrometer]        measurements of this sensor, on their way to all controllers
    [network.act.nf]                 commands of this controller, on their way back to the plant

A sensor or controller without a table has a perfect link. rig.bus.impaired_link states what the values mean.
`rig run --net` writes the same in one line: "meas/vibrometer: delay 2 ms, jitter 0.5 ms, loss 1 %, reorder; seed 3".
`keys` reads this line as the keys of [network] that it defines, `described` writes a link in these words.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any

from annotated_types import Ge, Le
from pydantic import Field, ValidationInfo, field_validator

from rig.bus.impaired_link import ImpairedLink
from rig.errors import UsageError
from rig.quantities import Section
from rig.scenes.faults import near
from rig.scenes.protocol import Share
from rig.sensors.chain.units import Delay

EXAMPLE = "meas/vibrometer: delay 2 ms, jitter 0.5 ms, loss 1 %, duplicate 0.1 %, reorder; seed 3"
_LINK = re.compile(r"(meas|act)/([A-Za-z][A-Za-z0-9_]*)")


class Link(Section):
    """One link.

    delay      mean time that a message is under way [chosen]
    jitter     half the range of this time, which is uniform within delay +- jitter [chosen]
    loss       probability that a message is lost [chosen]
    duplicate  probability that a message arrives twice [chosen]
    reorder    whether messages overtake each other; if not, a late one delays those behind it [chosen]
    """

    delay: Delay = 0
    jitter: Delay = 0
    loss: Share = 0.0
    duplicate: Share = 0.0
    reorder: bool = False

    @field_validator("jitter")
    @classmethod
    def _within_delay(cls, jitter: int, info: ValidationInfo) -> int:
        delay = info.data.get("delay")
        if delay is not None and jitter > delay:
            raise ValueError(
                f"is more than the delay of {delay / 1e6:g} ms; a message cannot arrive before it is sent, so at most "
                f"{delay / 1e6:g} ms are possible"
            )
        return jitter

    def made(self, name: str, seed: int, frame_ns: int) -> ImpairedLink:
        """The link as the plant runs it."""
        return ImpairedLink(name, seed, frame_ns, self.delay, self.jitter, self.loss, self.duplicate, self.reorder)

    def ticks(self, frame_ns: int) -> tuple[int, int]:
        """Smallest and largest transmission time [frames], rounded up: a message is received at the next tick."""
        link = self.made("", 0, frame_ns)
        return link.least, link.most


class Network(Section):
    """All links of a scene that are not perfect. `seed`: of their random numbers; without it, the seed of the scene."""

    seed: Annotated[int, Ge(0), Le(2**63)] | None = Field(default=None, strict=True)
    meas: dict[str, Link] = Field(default_factory=dict)
    act: dict[str, Link] = Field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.meas or self.act)

    @property
    def links(self) -> dict[str, Link]:
        """Topic of the bus -> link: meas/vibrometer, act/nf."""
        return {f"{room}/{name}": link for room in ("meas", "act") for name, link in getattr(self, room).items()}


def checks(raw: Any, sensors: Iterable[str], controllers: Iterable[str]) -> Iterator[tuple[str, str]]:
    """(dotted key, line) for each link of an unknown sensor or controller in the table `raw` of a scene."""
    for room, what, known in (("meas", "sensor", [*sensors]), ("act", "controller", [*controllers])):
        table = raw.get(room) if isinstance(raw, Mapping) else None
        for name in table if isinstance(table, Mapping) else ():
            if name not in known:
                key = f"network.{room}.{name}"
                yield key, f"{key}: unknown {what}; {near(name, known)}"


def keys(texts: Iterable[str], given: Iterable[str] = ()) -> dict[str, str]:
    """Dotted key of a scene -> value, for links in the form above; `given`: keys that the caller sets otherwise.

    Words and values are checked when the scene is loaded. Raises UsageError with all faults of the texts.
    """
    values: dict[str, str] = {}
    faults: list[str] = []
    for text in texts:
        for key, value in _read(text):
            if not key:
                faults.append(f'--net "{text}": {value}')
            elif values.setdefault(key, value) != value:
                faults.append(f'--net "{text}": {key} is given twice, as {values[key]} and as {value}')
    faults += [f"--net and -p: both give {key}; leave out one of them" for key in given if key in values]
    if faults:
        raise UsageError("\n".join([*faults, f'expected e.g. --net "{EXAMPLE}"']))
    return values


def _read(text: str) -> Iterator[tuple[str, str]]:
    """(key, value) of each value in a text; a fault has no key, and what is wrong as value."""
    link, _, rest = text.partition(":")
    words, _, seed = rest.partition(";")
    form = _LINK.fullmatch(link.strip())
    if form is None or not words.strip():
        yield "", f"{link.strip() or 'nothing'}: a link is meas/SENSOR or act/CONTROLLER, then a colon, then its values"
        return
    for part in filter(None, map(str.strip, words.split(","))):
        word, _, value = part.partition(" ")
        yield f"network.{form[1]}.{form[2]}.{word}", value.strip() or ("true" if word == "reorder" else "")
    if seed:
        word, _, value = seed.strip().partition(" ")
        key = "network.seed" if word == "seed" else ""
        yield key, value if key else f"{seed.strip()}: only the seed may be after the semicolon"


def described(link: Mapping[str, object]) -> str:
    """A link in the words of --net. `link`: its values in SI."""
    units = {"delay": (1e3, "ms"), "jitter": (1e3, "ms"), "loss": (1e2, "%"), "duplicate": (1e2, "%")}
    given = {word: float(link[word]) for word in units if link.get(word)}  # type: ignore[arg-type]
    words = []
    for word, value in given.items():
        factor, unit = units[word]
        words.append(f"{word} {value * factor:g} {unit}")
    if link.get("reorder"):
        words.append("reorder")
    return ", ".join(words) or "perfect"
