"""The generated code of the messages is that of rig.proto, and recordings keep the schemas that they had."""

from pathlib import Path

import pytest
from google.protobuf import descriptor_pb2
from google.protobuf.descriptor_pb2 import FieldDescriptorProto
from mcap.reader import make_reader

import rig.bus
import rig.record
from rig.bus import messages, rig_pb2, topics, viewing_pb2

ROOT = Path(__file__).parents[2]
SOURCE, VIEWING = (Path(rig.bus.__file__).parent / name for name in ("rig.proto", "viewing.proto"))


@pytest.fixture
def proto_source(monkeypatch):
    """The reader of .proto files that the site uses."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    import proto_source

    return proto_source


@pytest.mark.parametrize(("source", "made", "count"), [(SOURCE, rig_pb2, 9), (VIEWING, viewing_pb2, 1)])
def test_the_generated_code_has_exactly_the_messages_of_the_proto_file(proto_source, source, made, count):
    text = source.read_text()
    generated = descriptor_pb2.FileDescriptorProto()
    made.DESCRIPTOR.CopyToProto(generated)
    assert proto_source.package(text) == f"{generated.syntax} {generated.package}" == "proto3 rig"
    read = {one.name: [field[:4] for field in one.fields] for one in proto_source.messages(text)}
    assert len(read) == len(generated.message_type) == count
    for message in generated.message_type:
        assert read[message.name] == [
            (
                field.number,
                field.name,
                FieldDescriptorProto.Type.Name(field.type).removeprefix("TYPE_").lower(),
                field.label == FieldDescriptorProto.LABEL_REPEATED,
            )
            for field in message.field
        ]


@pytest.mark.parametrize("name", ["late_joiner", "pendulum"])
def test_the_schemas_of_recordings_still_hold(name):
    """No type of theirs has changed; types were added since. The newest has the very bytes that are written today."""
    with (ROOT / "recordings" / "golden" / f"{name}.mcap").open("rb") as file:
        schemas = make_reader(file).get_summary().schemas.values()
    recorded = {one.data for one in schemas if one.name.removeprefix("rig.") in messages.TYPES}
    today = descriptor_pb2.FileDescriptorSet.FromString(messages.file_descriptor_set(messages.TYPES["Act"]))
    assert recorded
    for data in recorded:
        found = descriptor_pb2.FileDescriptorSet.FromString(data)
        assert all(one in today.file[0].message_type for one in found.file[0].message_type)
    if name == "late_joiner":
        kinds = {row.message for row in topics.TABLE if row.recorded} - {"State"}
        assert recorded == {messages.file_descriptor_set(messages.TYPES[kind]) for kind in kinds}
