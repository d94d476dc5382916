"""Queries from other processes and the server that answers them, at once or later, in the thread that polls it."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from rig.bus.inbound import InboundCheck
from rig.bus.topics import Arrived, Refused
from rig.errors import RigError, UsageError

_QUESTIONS = 16
"""Most queries that one call of `Server.poll` answers."""
WAITING = 1 << 8
"""Most queries that wait for an answer."""

Later = Callable[[], "dict[str, Any] | None"]
"""An answer that takes time: called at every poll until it returns something."""
Answer = Callable[[dict[str, Any]], "dict[str, Any] | bytes | Later"]


class Request(ABC):
    """A query from another process; it must be answered or refused exactly once."""

    asked: Arrived

    @abstractmethod
    def reply(self, text: bytes) -> None:
        """Answer with JSON text."""

    @abstractmethod
    def refuse(self, why: str) -> None:
        """Refuse the query and give the reason."""


class ParamRequest(NamedTuple):
    """A request on `param/<process>`: list all that can be set, or make `changes` and return the values of `keys`."""

    everything: bool
    keys: list[str]
    changes: dict[str, Any]


def param_request(body: dict[str, Any]) -> ParamRequest:
    """Read a request on `param/<process>`. Raises UsageError if it is malformed."""
    keys = body.get("get", [])
    changes = body.get("set", {})
    if unknown := [key for key in body if key not in ("get", "set", "list")]:
        raise UsageError(f'the request has {unknown[0]!r:.80}; it can have "get" and "set", or "list" alone')
    if not (isinstance(keys, list) and all(isinstance(key, str) for key in keys)):
        raise UsageError(f'"get" is {keys!r:.80}; expected a list of keys, e.g. ["load.force"]')
    if not isinstance(changes, dict):
        raise UsageError(f'"set" is {changes!r:.80}; expected the keys to change, each with its value')
    if body.get("list", True) is not True:
        raise UsageError(f'"list" is {body["list"]!r:.80}; expected true')
    if "list" in body and len(body) > 1:
        raise UsageError('"list" comes alone; send "get" or "set" as a separate request')
    return ParamRequest("list" in body, keys, changes)


def check_parameters(answer: dict[str, Any], everything: bool) -> None:
    """Raise Refused for an answer on `param/<process>` of another form; `everything`: it lists all that can be set."""
    values, units, overruled = (answer.get(key, {}) for key in ("values", "units", "overruled"))
    if not all(isinstance(part, dict) for part in (values, units, overruled)) or "values" not in answer:
        raise Refused("not parameters", 'it has no object of "values"')
    without_unit = [key for key in values if not isinstance(units.get(key), str)]
    if everything and without_unit:
        raise Refused("not parameters", f"{without_unit[0]!r:.80} has no unit")


class Server(ABC):
    """Answers the queries on one topic, in the thread that calls `poll`."""

    def __init__(self, inbound: InboundCheck, answer: Answer) -> None:
        self.inbound = inbound
        self._answer = answer
        self.asker = ""
        """The user whose query is being answered."""
        self._later: list[tuple[Request, dict[str, Any], Later]] = []

    waiting: Callable[[], int]
    """The number of queries that have arrived and are not read."""

    @abstractmethod
    def _next(self, timeout: float) -> Request | None: ...

    def poll(self, timeout: float = 0.0) -> int:
        """Answer the waiting queries and return their number; wait at most `timeout` seconds for the first.

        A query that cannot be read or raises an exception is refused, and the refusal contains the reason.
        """
        if not (self._later or self.waiting() or timeout):  # the usual case, in every frame
            return 0
        if self._later:
            waiting = self._later
            self._later = []
            for asked, body, later in waiting:
                self._serve(asked, body, later)
        answered = 0
        while answered < _QUESTIONS:
            request = self._next(0.0 if answered else timeout)
            if request is None:
                break
            answered += 1
            question = self.inbound.let_in(self.inbound.question, request.asked)
            if question is None:
                request.refuse(f"{self.inbound.last.kind}: {self.inbound.last}")
            else:
                self._serve(request, question, partial(self._answer, question))
        return answered

    def give_up(self, why: str) -> None:
        """Refuse all queries that wait for an answer, read or not, since `poll` is not called any more."""
        for request, _, _ in self._later:
            request.refuse(why)
        self._later = []
        while (unread := self._next(0.0)) is not None:
            unread.refuse(why)

    def _serve(self, request: Request, body: dict[str, Any], answer: Callable[[], Any]) -> None:
        """Answer or refuse a request, or keep it for the next poll."""
        self.asker = request.asked.user
        try:
            reply = answer()
            if reply is None or callable(reply):
                self._later.append((request, body, reply or answer))
                return
            text = reply if isinstance(reply, bytes) else json.dumps(reply).encode()
        except (RigError, ValueError) as fault:
            request.refuse(str(fault))
        except KeyError as fault:
            request.refuse(f"{body.get('do', 'the request')!s:.80} needs {fault}")
        except Exception as fault:  # a senseless query must not end the process that answers
            request.refuse(f"{body!r:.200} cannot be done: {type(fault).__name__}: {fault}")
        else:
            request.reply(text)
