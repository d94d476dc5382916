"""The section [network] of a scene: links between plant and controllers that are made worse on purpose.

    [network.meas.vibrometer]        measurements of this sensor, on their way to all controllers
    [network.act.nf]                 commands of this controller, on their way back to the plant

A sensor or controller without a table has a perfect link. rig.bus.impaired_link states what the values mean.
`rig run --net` writes the same in one line: "meas/vibrometer: delay 2 ms, jitter 0.5 ms, loss 1 %, reorder; seed 3".

Impaired links in one line, as `rig run --net` takes them, and as the keys of [network] that they define.

meas/vibrometer: delay 2 ms, jitter 0.5 ms, loss 1 %, duplicate 0.1 %, reorder; seed 3
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
from rig.scenes.faults import close, near
from rig.scenes.protocol import Share
from rig.sensors.chain.units import Delay


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
        if "delay" in info.data and jitter > (delay := info.data["delay"]):
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


ROOMS = ("meas", "act")
EXAMPLE = "meas/vibrometer: delay 2 ms, jitter 0.5 ms, loss 1 %, duplicate 0.1 %, reorder; seed 3"
_WORDS = [*Link.model_fields]
_PART = re.compile(r"[^,;]+")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_VALUE = re.compile(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*)")


def keys(texts: Iterable[str], given: Iterable[str] = ()) -> dict[str, str]:
    """Dotted key of a scene -> value, for links in the form above; `given`: keys that the caller sets otherwise.

    Values and names are checked when the scene is loaded. Raises UsageError with all faults of the texts, each with
    its column.
    """
    values: dict[str, str] = {}
    faults: list[str] = []
    for text in texts:
        for column, key, value in _read(text):
            if not key:
                faults.append(f'--net "{text}", column {column}: {value}')
            elif values.get(key, value) != value:
                faults.append(f'--net "{text}", column {column}: {key} is given twice, as {values[key]} and as {value}')
            else:
                values[key] = value
    faults += [f"--net and -p: both give {key}; leave out one of them" for key in given if key in values]
    if faults:
        raise UsageError("\n".join([*faults, f'expected e.g. --net "{EXAMPLE}"']))
    return values


def _read(text: str) -> Iterator[tuple[int, str, str]]:
    """(column, key, value) of each value in a text; a fault has no key, and what is wrong as value."""
    link, colon, rest = text.partition(":")
    room, slash, name = link.strip().partition("/")
    if not colon or not slash or room not in ROOMS or not _NAME.fullmatch(name):
        yield 1, "", _no_link(link.strip(), room, slash, colon)
        if not colon:
            return
    words: dict[str, int] = {}
    for part in _PART.finditer(rest):
        column = len(link) + 2 + part.start() + len(part.group()) - len(part.group().lstrip())
        word, _, value = part.group().strip().partition(" ")
        last = rest[part.start() - 1 : part.start()] == ";"
        if word in words:
            yield column, "", f"{word} is given twice"
        elif word:
            yield column, *_value(room, name, word, value.strip(), last)
        words[word] = column
    if not any(words):
        yield len(text) + 1, "", f"says nothing about the link; known: {', '.join(_WORDS)}"


def _no_link(link: str, room: str, slash: str, colon: str) -> str:
    form = "a link is meas/SENSOR or act/CONTROLLER, then a colon"
    if slash and room not in ROOMS and (likely := close(room, ROOMS)):
        return f"{link}: did you mean {link.replace(room, likely[0], 1)}? {form}"
    return f"{link or 'nothing'}{'' if colon else ' has no colon'}: {form}"


def _value(room: str, name: str, word: str, value: str, last: bool) -> tuple[str, str]:
    if word == "seed":
        if not last:
            return "", 'seed must be at the end, after a semicolon: "...; seed 3"'
        return ("network.seed", value) if value.isdecimal() else ("", f"seed {value}: expected a whole number")
    if word not in Link.model_fields:
        likely = close(word, [*_WORDS, "seed"])
        hint = f"did you mean {' or '.join(likely)}?" if likely else f"known: {', '.join(_WORDS)}, seed"
        return "", f"{word}: unknown; {hint}"
    if last:
        return "", f"{word} is after a semicolon; only the seed may be there, the rest is separated by commas"
    key = f"network.{room}.{name}.{word}"
    if word == "reorder":
        return (key, "true") if not value else ("", f"reorder {value}: reorder takes no value")
    if (number := _VALUE.fullmatch(value)) is None:
        return "", f"{word} {value}: expected a number and a unit".replace(f"{word} :", f"{word}:")
    return key, f"{number[1]} {number[2]}".strip()


def described(link: Mapping[str, object]) -> str:
    """A link in the words of --net. `link`: its values in SI."""
    units = {"delay": (1e3, "ms"), "jitter": (1e3, "ms"), "loss": (1e2, "%"), "duplicate": (1e2, "%")}
    given = {word: float(link[word]) for word in units if link.get(word)}  # type: ignore[arg-type]
    words = [f"{word} {value * units[word][0]:g} {units[word][1]}" for word, value in given.items()]
    return ", ".join([*words, *(["reorder"] if link.get("reorder") else [])]) or "perfect"
