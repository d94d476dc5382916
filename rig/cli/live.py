"""Commands for a run that is going on: they change or stop it, and look at its messages."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rig.cli import printing
from rig.cli.build import Made, Told
from rig.cli.options import Command, RunName, Ticket, number
from rig.errors import BusError, UsageError
from rig.parameters import Argument, Option
from rig.printable import counted
from rig.units import number_or_text, with_point

if TYPE_CHECKING:
    from rig.bus.port import Session


Pattern = Annotated[str, Argument("PATTERN", 'Topics: "*" matches one part of a name, "**" all following parts.')]
For = Annotated[float, Option("TIME", "Time to listen, in seconds or with a unit.", "--for", low=0.01)]
Name = Annotated[str, Argument("NAME", "A controller of the run, connected or not.")]


def listing(title: str, heads: Mapping[str, str], rows: Sequence[Mapping[str, Any]]) -> Told:
    """Rows, as a table for a reader; `heads`: key of a row -> head of its column."""
    cells = [[*map(row.__getitem__, heads)] for row in rows]
    return Told(rows, show=lambda: printing.table(title, [*heads.values()], cells))


class Numbers(Command):
    """A command among whose arguments are numbers: -0.8 is one, and no option."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put what is a negative number behind the options, where nothing is taken for one."""
        if "--" not in args:
            negative = [argument for argument in args if re.match(r"-\.?\d", argument)]
            others = [argument for argument in args if argument not in negative]
            args = [*others, "--", *negative] if negative else others
        return super().parse_args(ctx, args)


def tune(
    key: Annotated[
        str | None,
        Argument("KEY", "Actuator or parameter, e.g. friction.mu_static. Without it: list all."),
    ] = None,
    value: Annotated[
        str | None,
        Argument("VALUE", 'A number, or a number with a unit: "15 N". Without it: show the value.'),
    ] = None,
    run: RunName = None,
    ticket: Ticket = None,
) -> Told:
    """Show or change a value of a live run. The change takes effect at the next step and is recorded.

    Without VALUE: show the current value. Without KEY: list everything that
    can be tuned. A parameter of a controller is named NAME.KEY or
    controllers.NAME.KEY. An actuator that a controller drives takes the value
    when the controller is disconnected.
    """
    from rig import bus

    with bus.join(run, role="operator", name="tune", ticket=ticket) as session:
        if key is None:
            return _tunable(session)
        process, inner = _owner(session, key)
        body = {"get": [inner]} if value is None else {"set": {inner: number_or_text(with_point(value, key))}}
        try:
            answer = session.ask(f"param/{process}", body, timeout=10.0)
        except BusError as fault:
            raise UsageError(f"{fault}\n`rig live tune` without a key lists what can be tuned") from None
    overruled = {} if value is None else answer.get("overruled", {})  # a value that was asked for is the one in force
    new = printing.number(answer["values"].get(inner))
    owner = overruled.get(inner)
    told = f"{key} = {new}"
    if owner:
        told = f"{owner} drives {key}; the value {new} takes effect when {owner} is disconnected"
    report = answer["values"] | ({"overruled": overruled} if overruled else {}) | {"run": session.run}
    return Told(report, f"{told}  (run {session.run})")


def connect(name: Name, run: RunName = None, ticket: Ticket = None) -> None:
    """Connect a controller of a live run to its actuators. The recording contains it, as a step of the protocol."""
    _command(
        "connect", run, ticket, f"{name} is connected from t = {{t:.3f}} s on: it drives its actuators", controller=name
    )


def disconnect(name: Name, run: RunName = None, ticket: Ticket = None) -> None:
    """Disconnect a controller of a live run from its actuators. The recording contains it, as a step of the protocol.

    The actuators take the values of the protocol or of rig live tune. A controller
    that has left keeps its actuators until it is disconnected.
    """
    told = f"{name} is disconnected from t = {{t:.3f}} s on: its actuators take the values of the protocol"
    _command("disconnect", run, ticket, told, controller=name)


def pause(run: RunName = None, ticket: Ticket = None) -> None:
    """Pause a live run: no frame is computed until rig live resume, except by rig live step."""
    _command("pause", run, ticket, "paused at t = {t:.6f} s", "was paused already, at t = {t:.6f} s")


def resume(run: RunName = None, ticket: Ticket = None) -> None:
    """Continue a paused run."""
    _command("resume", run, ticket, "continues from t = {t:.6f} s", "was not paused; it is at t = {t:.6f} s")


def step(
    frames: Annotated[int, Option("N", "Number of frames.", low=1, high=10_000)] = 1,
    run: RunName = None,
    ticket: Ticket = None,
) -> None:
    """Compute single frames of a paused run: with each one its controllers receive one step."""
    _command("step", run, ticket, f"{counted(frames, 'single step')} from t = {{t:.6f}} s", frames=frames)


def stop(
    emergency: Annotated[bool, Option("", "Set all actuators to their safe values at once, then stop.")] = False,
    run: RunName = None,
    ticket: Ticket = None,
) -> None:
    """End a live run in order. The recording contains it."""
    if emergency:
        _command(
            "emergency",
            run,
            ticket,
            "emergency stop at t = {t:.6f} s: all actuators go to their safe values, then it ends",
        )
    else:
        _command("stop", run, ticket, "stopped at t = {t:.6f} s")


def knock(
    impulse: Annotated[str, Argument("IMPULSE", 'In N s, or with a unit: "0.02 N*s".')],
    run: RunName = None,
    ticket: Ticket = None,
) -> None:
    """Apply an impulse to the body of a live run. The recording contains it."""
    size = number(impulse, "IMPULSE", "N*s", -1e6, 1e6)
    _command("knock", run, ticket, f"knock with {size:g} N s at t = {{t:.6f}} s", impulse=size)


def _command(what: str, run: str | None, ticket: Path | None, told: str, unchanged: str = "", **more: Any) -> None:
    """Ask the plant to do something, and tell that it did, with the time `t` [s] and the run.

    `unchanged`: what is told if there was nothing to change.
    """
    from rig import bus

    with bus.join(run, role="operator", name=what, ticket=ticket) as session:
        answer = session.ask("cmd/plant", {"do": what, **more}, timeout=10.0)
    text = told if answer.get("changed", True) else unchanged
    printing.line(f"{text.format(t=float(answer['t_ns']) * 1e-9)}  (run {session.run})")


def _controllers(session: Session) -> list[str]:
    return sorted(name for _, name in session.present("controller/*"))


def _owner(session: Session, key: str) -> tuple[str, str]:
    """Who has the parameter, and what it is called there: a key of the plant comes first."""
    first, _, rest = key.partition(".")
    controllers = _controllers(session)
    if first == "controllers":
        name, _, inner = rest.partition(".")
    elif first not in controllers or (rest and key in _parameters(session, "plant")["values"]):
        return "plant", key
    else:
        name = first
        inner = rest
    if not inner:
        raise UsageError(f"{key}: name the parameter too, e.g. {key}.gain; `rig live tune` lists what can be tuned")
    if name not in controllers:
        raise UsageError(f"{key}: no controller {name} is in the run; there are: {', '.join(controllers) or 'none'}")
    return name, inner


def _parameters(session: Session, process: str) -> Any:
    """What can be tuned of the plant or a controller: `values` and `units` by key."""
    return session.ask(f"param/{process}", {"list": True}, timeout=10.0)


def _tunable(session: Session) -> Told:
    names = ("plant", *_controllers(session))
    answers = dict[str, Any]()
    for name in names:
        try:
            answers[name] = _parameters(session, name)
        except BusError as fault:
            if name == "plant":
                raise
            printing.note(f"{name}: {fault}")
    rows = [
        {"key": key if name == "plant" else f"{name}.{key}", "value": value, "unit": answer["units"][key], "of": name}
        for name, answer in answers.items()
        for key, value in answer["values"].items()
    ]
    columns = ("key", "value", "unit", "of")
    return listing(f"run {session.run}", dict(zip(columns, columns)), rows)


def topic_ls(run: RunName = None, ticket: Ticket = None, listen: For = 1.0) -> Told:
    """List the active topics, their senders and their contents."""
    from rig.bus import topics

    heard = [(name, topics.of(name), count) for name, (count, _) in sorted(_heard("**", run, ticket, listen).items())]
    columns = ("topic", "message", "from", "heard", "about")
    rows = [dict(zip(columns, (name, of.message, of.sender, count, of.about))) for name, of, count in heard]
    return listing("", dict(zip(columns, columns)), rows)


def topic_hz(pattern: Pattern = "**", run: RunName = None, ticket: Ticket = None, listen: For = 2.0) -> Told:
    """Count messages per second of each topic, and lost messages."""
    heard = sorted(_heard(pattern, run, ticket, listen).items())
    rows = [{"topic": name, "hz": count / listen, "lost": lost} for name, (count, lost) in heard]
    return listing("", {"topic": "topic", "hz": "1/s", "lost": "lost"}, rows)


def topic_echo(
    pattern: Pattern,
    run: RunName = None,
    ticket: Ticket = None,
    count: Annotated[int, Option("", "Number of messages; 0: all, until the run ends or Ctrl-C.", low=0)] = 0,
) -> None:
    """Print messages as they arrive, one JSON object per line."""
    from google.protobuf.json_format import MessageToDict

    from rig import bus
    from rig.bus import run_setup

    stopped = nullcontext() if count else suppress(KeyboardInterrupt)  # without a count it has no end of its own
    with bus.join(run, role="operator", name="echo", ticket=ticket) as session, stopped:
        receiver = session.subscribe(pattern)
        plant = session.watch("plant/*")
        run_setup.fetch(session)  # from here on its states are read
        shown = 0
        while session.goes_on(plant) and (not count or shown < count):
            message = receiver.get(timeout=0.1)
            if message is not None:
                fields = MessageToDict(message.said, preserving_proto_field_name=True)
                printing.line(json.dumps({"topic": message.topic, "seq": message.seq, "t_ns": message.t_ns, **fields}))
                shown += 1


def _heard(pattern: str, run: str | None, ticket: Path | None, listen: float) -> dict[str, tuple[int, int]]:
    """Topic -> messages received and lost within `listen` seconds."""
    from rig import bus

    with bus.join(run, role="operator", name="topic", ticket=ticket) as session:
        receiver = session.subscribe(pattern, depth=1 << 16, polled=True)
        until = time.monotonic() + listen
        while time.monotonic() < until:
            time.sleep(0.02)
            receiver.drain()
        return {name: (count.received, count.lost) for name, count in receiver.counts.items()}


CLASSES = {"tune": Numbers, "knock": Numbers}
"""Of commands that are read in a way of their own."""
COMMANDS = {
    "tune": Made(tune, 'rig live tune load.force "15 N"'),
    "disconnect": Made(disconnect, "rig live disconnect nf"),
    "connect": Made(connect, "rig live connect nf"),
    "knock": Made(knock, 'rig live knock "0.02 N*s"'),
    "pause": Made(pause, "rig live pause"),
    "step": Made(step, "rig live step --frames 10"),
    "resume": Made(resume, "rig live resume"),
    "stop": Made(stop, "rig live stop   |   rig live stop --emergency"),
    "ls": Made(topic_ls, "rig live topic ls"),
    "hz": Made(topic_hz, 'rig live topic hz "meas/*" --for 5'),
    "echo": Made(topic_echo, "rig live topic echo meas/vibrometer --count 3"),
}
