"""The mark on every object that the operator made: a hash of what it applied."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fleet.spec.base import GROUP
from fleet_operator.resources.refs import Manifest

APPLIED_ANNOTATION = f"{GROUP}/applied"
_BYTES = 10
_METADATA = '"metadata":{'


@dataclass(frozen=True, slots=True)
class Sealed:
    """A manifest as it is sent.

    Args:
        digest: What its annotation says.
        text: Its JSON, with the annotation.
    """

    digest: str
    text: bytes


def applied_hash(manifest: Mapping[str, Any]) -> str:
    """What the annotation of an object made from this manifest says; the order of keys does not count."""
    return seal(manifest).digest


def seal(manifest: Mapping[str, Any]) -> Sealed:
    """A manifest with the annotation; one that it has already does not count."""
    metadata = dict(manifest["metadata"])
    annotations = dict(metadata.pop("annotations", {}))
    annotations.pop(APPLIED_ANNOTATION, None)
    # All but the few annotations is the same with and without the mark, so it is written once for both.
    rest = _json({key: value for key, value in manifest.items() if key != "metadata"} | {"metadata": metadata})
    digest = hashlib.blake2b((rest + _json(annotations)).encode(), digest_size=_BYTES).hexdigest()
    marked = _json(annotations | {APPLIED_ANNOTATION: digest})
    start = rest.index(_METADATA) + len(_METADATA)  # the first: no key before it holds objects that have metadata
    comma = "" if rest[start] == "}" else ","
    return Sealed(digest, f'{rest[:start]}"annotations":{marked}{comma}{rest[start:]}'.encode())


def marked(manifest: Mapping[str, Any], digest: str) -> Manifest:
    """The manifest with its annotation."""
    metadata = manifest["metadata"]
    annotations = {**metadata.get("annotations", {}), APPLIED_ANNOTATION: digest}
    return {**manifest, "metadata": {**metadata, "annotations": annotations}}


def mark_of(body: Mapping[str, Any]) -> str:
    """What the annotation of an object says; "" when it has none."""
    mark: str = body["metadata"].get("annotations", {}).get(APPLIED_ANNOTATION, "")
    return mark


def _json(value: Mapping[str, Any]) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"))
