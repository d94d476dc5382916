"""Reference of topics and messages, generated from the tables of the bus."""

from collections.abc import Iterable

from generated import code, directive, plain, table
from sphinx.application import Sphinx

from rig.bus import messages
from rig.bus.topics import TABLE

_TYPES = {"int": "int64", "real": "float64", "text": "text", "data": "bytes"}


def topics() -> Iterable[str]:
    """The table of all topics."""
    heads = ("topic", "content", "message", "sender", "recorded", "transport")
    for_message = {name: f"[{name}](#message-{name.lower()})" for name in messages.DECLARED}
    return table(
        heads,
        [
            (
                code(one.name),
                plain(one.about),
                for_message.get(one.message, one.message),
                one.sender,
                "yes" if one.recorded else "no",
                ", ".join(filter(None, (one.way, one.priority.lower().replace("_", " ")))),
            )
            for one in TABLE
        ],
    )


def message_types() -> Iterable[str]:
    """A section for each type of message: what it is, and its fields in order."""
    for name, fields in messages.DECLARED.items():
        yield from (f"(message-{name.lower()})=", f"### {name}", "", plain(messages.ABOUT[name]), "")
        rows = []
        for number, field in enumerate(fields.split(), 1):
            key, _, kind = field.partition(":")
            many = kind.endswith("*")
            rows.append((str(number), code(key), _TYPES[kind.rstrip("*")] + (", repeated" if many else "")))
        yield from table(("number", "field", "type"), rows)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives `topics` and `messages`."""
    directive(app, "topics", topics)
    directive(app, "messages", message_types)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
