"""Losses of messages by sender: what each states to have sent, against what was received from it.

A process that leaves may be followed by another one of the same name, which counts its messages from 0 again. Each of
them is a life of the sender.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from rig.bus import topics


@dataclass
class _Life:
    """The messages of one process until it left and a successor of its name began to count anew."""

    last: dict[str, int] = field(default_factory=dict)
    """Topic -> number of the last received message."""
    stated: dict[str, int] = field(default_factory=dict)
    """Topic -> number of messages that it states to have sent."""

    def tail(self) -> dict[str, int]:
        """Return topic -> messages missing after the last one received."""
        return {topic: topics.Count(last=self.last.get(topic, -1)).tail(sent) for topic, sent in self.stated.items()}


class SenderLives:
    """The lives of all senders of a run, from their messages in the order of arrival."""

    def __init__(self) -> None:
        self._lives: dict[str, _Life] = {}
        """Sender -> its present life."""
        self._tails: Counter[str] = Counter()
        """Messages missing at the end of finished lives, by topic."""
        self.untold: set[str] = set()
        """Senders with a life that ended before they stated their totals."""

    def follow(self, message: topics.Message) -> None:
        """Note the number of a message; a number not above the last one on its topic belongs to a new life."""
        owner = topics.owner(message.topic)
        life = self._lives.get(owner)
        if life is None or message.seq <= life.last.get(message.topic, -1):
            life = self._anew(owner, {})
        life.last[message.topic] = message.seq

    def _anew(self, owner: str, last: dict[str, int]) -> _Life:
        """Begin a new life of a sender, of which the messages up to `last` have been received."""
        before = self._lives.get(owner)
        life = _Life(last)
        if before is not None:
            self._tails.update(before.tail())
            if not before.stated:
                self.untold.add(owner)
        self._lives[owner] = life
        return life

    def compare(self, message: topics.Message) -> None:
        """Compare what a sender states to have sent, its Totals `message`, with what was received from it."""
        owner = topics.owner(message.topic)
        life = self._lives[owner]
        stated = dict(zip(message.said.sent_topic, message.said.sent))
        past = {topic for topic, sent in stated.items() if topic != message.topic and life.last.get(topic, -1) >= sent}
        if past and owner != "plant":  # the plant continues to send, and may overtake its total
            # More was received than this sender sent: it came from a predecessor, and nothing of this sender arrived.
            life = self._anew(owner, {topic: last for topic, last in life.last.items() if topic not in past})
        life.stated = stated

    def tails(self) -> dict[str, int]:
        """Topic -> number of messages missing after the last one received, of all lives."""
        tails = self._tails.copy()
        for life in self._lives.values():
            tails.update(life.tail())
        return {topic: tail for topic, tail in tails.items() if tail}
