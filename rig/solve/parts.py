"""The parts of compiled code that a rig needs (rig.solve.leaf), where they begin, and two processes that compile them.

The second process takes the parts from the end of the list, this one from its begin; none is compiled by both
(rig.kept.Folder.claimed).
"""

from __future__ import annotations

import base64
import importlib
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rig import scheduling
from rig.child import Child, end
from rig.kernel import FOLDER
from rig.solve.leaf import Shape

_ADDRESSES: dict[tuple[Any, Shape], int] = {}
_HUNG = 120.0  # s that another process may compile one part
_PATIENCE = 5.0  # s, for the second process to end


@contextmanager
def _beside(names: Sequence[str], kinds: tuple[Any, ...]) -> Iterator[None]:
    """While these parts are compiled here, another process does so too, from the last one on; it ends with this."""
    # Another thread than the main one builds beside a run, whose cores are not to be taken.
    apart = threading.current_thread() is not threading.main_thread() or "RIG_OWN_PROCESS" not in os.environ
    if len(names) < 2 or not FOLDER.keeps or scheduling.cores() < 2 or apart:
        yield
        return
    task = base64.b64encode(pickle.dumps((list(reversed(names)), kinds))).decode()
    fellow = Child("compiler", ["rig.solve.parts", task])
    try:
        yield
    finally:
        fellow.send(signal.SIGTERM)  # all is there, or is not wanted any more
        end([fellow], _PATIENCE)


def addresses(wanted: Mapping[str, tuple[Any, Shape]], kinds: Callable[[], Sequence[Any]]) -> dict[str, int]:
    """Where the code of each of `wanted`, by name, begins: of a leaf or another part, for this shape.

    part(shape, t, w, state, log, seg, plan, ticks) -> int; `kinds`: types of t .. ticks. What has not been compiled is
    compiled, by two processes where this one is a command's.
    """
    missing = {_name(*one): one for one in wanted.values() if one not in _ADDRESSES}
    if missing:
        common = tuple(kinds())
        with _beside([name for name in missing if not FOLDER.noted(name)], common):
            compiled(missing, common)
    return {name: _ADDRESSES[one] for name, one in wanted.items()}


def compiled(missing: Mapping[str, tuple[Any, Shape]], kinds: tuple[Any, ...]) -> None:
    """Compile these parts, by name, or take what is kept. What another process is compiling is waited for last."""
    for longest in (0.0, _HUNG):
        for name, (part, shape) in missing.items():
            if (part, shape) in _ADDRESSES:
                continue
            with FOLDER.claimed(name, longest) as mine:
                if mine:
                    part.compile((shape, *kinds))
                    code = part.overloads[(shape, *kinds)]
                    _ADDRESSES[part, shape] = code.library.get_pointer_to_function(code.fndesc.llvm_func_name)


def _name(part: Any, shape: Shape) -> str:
    return f"{part.__module__}.{part.__name__}.{shape.states}.{shape.products:d}.{shape.bends:d}"


def named(name: str) -> tuple[Any, Shape]:
    """The part and the shape of a name of `compiled`."""
    *module, part, states, products, bends = name.split(".")
    found = getattr(importlib.import_module(".".join(module)), part)
    return found, Shape(int(states), products == "1", bends == "1")


def main() -> None:
    """Compile what the command line says: `python -m rig.solve.parts TASK`."""
    names, kinds = pickle.loads(base64.b64decode(sys.argv[1]))
    compiled({name: named(name) for name in names}, kinds)


if __name__ == "__main__":
    main()
