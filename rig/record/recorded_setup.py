"""The description of the run that a recording contains.

Its reduced models are attachments of their own, `model/<digest>`, compressed by zstd.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace as changed
from pathlib import Path

import zstandard
from mcap.records import Attachment

from rig.bus.run_setup import Setup
from rig.errors import LogError
from rig.record.message_scan import Scan
from rig.structure import model_store

MEDIA_TYPE = "application/zstd"
_FOLDER = "model/"
_LARGEST = model_store.MEMORY  # bytes; a damaged length must not claim the memory of the machine


def name(model: bytes) -> str:
    """Return the name of the attachment for `model`."""
    return _FOLDER + model_store.digest(model)


def packed(model: bytes) -> bytes:
    """Return the content of the attachment; equal models give equal bytes."""
    return zstandard.ZstdCompressor(write_checksum=True).compress(model)


def models(attachments: Iterable[Attachment]) -> Iterator[bytes]:
    """Yield the models among `attachments`; one whose content does not match the digest in its name is left out."""
    for attachment in attachments:
        if attachment.name.startswith(_FOLDER):
            try:
                if zstandard.frame_content_size(attachment.data) > _LARGEST:
                    continue
                model = zstandard.ZstdDecompressor().decompress(attachment.data)
            except zstandard.ZstdError:
                continue
            if name(model) == attachment.name:
                yield model


def head(path: Path) -> Scan:
    """Return a scan up to setup and provenance: before the first message, or at the end if that part is damaged."""
    scan = Scan(path)
    for _ in scan:
        if {"setup.json", "scene.json"} <= scan.attachments.keys():
            break
    return scan


def setup_of(scan: Scan) -> Setup:
    """Return the description of the run in a recording; damaged parts, except the scene, are derived from its channels.

    Raises LogError if nothing describes a run.
    """
    scene = scan.attachments.get("scene.json")
    given = {"scene": scene.data.decode(errors="replace") if scene else ""}
    found_models = tuple(models(scan.attachments.values()))
    if (attached := scan.attachments.get("setup.json")) is None:
        return changed(_derived(scan, given["scene"]), models=found_models)
    try:
        return changed(Setup.from_json({**json.loads(attached.data), **given}), models=found_models)
    except (KeyError, TypeError, ValueError) as fault:
        raise LogError(f"{scan.path} does not describe its run: {fault!r} is missing or unreadable") from None


def _derived(scan: Scan, scene: str) -> Setup:
    """The description as far as the channels contain it."""
    outputs = dict[str, str]()
    sensors = dict[str, tuple[str, int]]()
    controllers = dict[str, dict[str, str]]()
    for channel in scan.channels.values():
        first, _, name = channel.topic.partition("/")
        unit = channel.metadata.get("v", "")
        if first == "state":
            outputs |= channel.metadata
        elif first == "truth" and name != "mode":
            outputs[name] = unit
        elif first == "meas":
            sensors[name] = (unit, 0)
        elif first == "applied":
            controllers[name] = {}
    if not (outputs or sensors):
        raise LogError(f"{scan.path} does not describe its run")
    run = scan.metadata.get("log", {}).get("run", scan.path.stem)
    return Setup(run, scene, 0, 0, outputs, sensors, controllers)
