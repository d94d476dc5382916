"""Reference of topics and messages, generated from the table of topics and from rig.proto and viewing.proto."""

from collections.abc import Iterable
from pathlib import Path

import proto_source
from generated import code, directive, plain, table
from sphinx.application import Sphinx

import rig.bus
from rig.bus.topics import TABLE

_TYPES = {"sfixed64": "int64", "double": "float64", "string": "text"}
_FILES = (Path(rig.bus.__file__).parent / name for name in ("rig.proto", "viewing.proto"))
_MESSAGES = [message for file in _FILES for message in proto_source.messages(file.read_text())]


def topics() -> Iterable[str]:
    """The table of all topics."""
    heads = ("topic", "content", "message", "sender", "recorded", "transport")
    for_message = {name: f"[{name}](#message-{name.lower()})" for name in [one.name for one in _MESSAGES]}
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
    for message in _MESSAGES:
        yield from (f"(message-{message.name.lower()})=", f"### {message.name}", "", plain(message.about), "")
        rows = []
        for field in message.fields:
            kind = _TYPES.get(field.type, field.type) + (", repeated" if field.repeated else "")
            rows.append((str(field.number), code(field.name), kind, plain(field.about)))
        yield from table(("number", "field", "type", "meaning"), rows)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives `topics` and `messages`."""
    directive(app, "topics", topics)
    directive(app, "messages", message_types)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
