"""Reduced models in a recording: one attachment per model, `model/<digest>`, compressed by zstd."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import zstandard
from mcap.records import Attachment

from rig.plants.structures import model_store

MEDIA_TYPE = "application/zstd"
_FOLDER = "model/"
_LARGEST = model_store.LIMIT  # bytes; a damaged length must not claim the memory of the machine


def name(model: bytes) -> str:
    """Return the name of the attachment for `model`."""
    return _FOLDER + model_store.digest(model)


def packed(model: bytes) -> bytes:
    """Return the content of the attachment; equal models give equal bytes."""
    return zstandard.ZstdCompressor(write_checksum=True).compress(model)


def models(attachments: Iterable[Attachment]) -> Iterator[bytes]:
    """Yield the models among `attachments`; one whose content does not match the digest in its name is left out."""
    for one in attachments:
        if one.name.startswith(_FOLDER):
            try:
                if zstandard.frame_content_size(one.data) > _LARGEST:
                    continue
                model = zstandard.ZstdDecompressor().decompress(one.data)
            except zstandard.ZstdError:
                continue
            if name(model) == one.name:
                yield model
