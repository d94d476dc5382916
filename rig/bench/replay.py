"""Plays a recording back on the bus, with controllers as processes that receive it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rig import bus, controllers
from rig.child_process import Child, end
from rig.errors import BusError, UsageError
from rig.record import replay as recorded
from rig.record.reader import head

JOIN_S = 30.0
LEAVE_S = 3.0


def replay(
    log: Path, into: Sequence[str] = (), pace: float | None = None, tell: Callable[[str], object] = lambda _: None
) -> recorded.Replayed:
    """Replay `log` on the bus; start the controllers `into` and compare their commands with the recorded ones.

    `into`: names of controllers of the scene, or Python files. `pace`: simulated time over wall time; None: as fast as
    the controllers answer. Raises UsageError for a name that is not in the recording, Untrusted for code that is not
    trusted, BusError if a controller does not join or leaves.
    """
    names = [Path(one).stem if one.endswith(".py") else one for one in into]
    there = head(log).setup().controllers
    unknown = [one for one in into if not one.endswith(".py") and one not in there]
    if unknown:
        known = ", ".join(there) or "none"
        raise UsageError(
            f"the recording has no controller {', '.join(unknown)}; it has: {known}. "
            "The name of a Python file must end in .py"
        )
    for one in set(into) & there.keys():
        controllers.restored(there[one])  # raises Untrusted before anything is started
    with bus.host(scene="replay") as session:
        tell(f"run {session.run}")
        joining = ["--run", session.run, "--wait", str(JOIN_S)]
        children = [Child(f"controller {one}", ["rig.controllers.runtime.process", one, *joining]) for one in into]
        try:
            return recorded.replay(session, log, names, pace, JOIN_S, lambda seconds: _at(tell, seconds))
        except BusError as fault:
            died = [child.told for child in children if child.code]
            raise BusError("\n".join([str(fault), *died])) from None
        finally:
            session.close()
            end(children, LEAVE_S)


def _at(tell: Callable[[str], object], seconds: float) -> None:
    tell(f"t {seconds:.1f} s")
