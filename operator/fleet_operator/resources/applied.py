"""The mark on every object that the operator made: a hash of what it applied."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from fleet.spec.base import GROUP
from fleet_operator.resources.refs import Manifest

APPLIED_ANNOTATION = f"{GROUP}/applied"
_BYTES = 10


def applied_hash(manifest: Mapping[str, Any]) -> str:
    """What the annotation of an object made from this manifest says; the order of keys does not count.

    Args:
        manifest: As the compiler makes it; an annotation that is already there does not count.
    """
    metadata = manifest["metadata"]
    annotations = metadata.get("annotations")
    if annotations and APPLIED_ANNOTATION in annotations:
        kept = {key: value for key, value in annotations.items() if key != APPLIED_ANNOTATION}
        metadata = {key: value for key, value in metadata.items() if key != "annotations"}
        manifest = {**manifest, "metadata": {**metadata, "annotations": kept} if kept else metadata}
    text = json.dumps(manifest, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=_BYTES).hexdigest()


def marked(manifest: Mapping[str, Any], digest: str) -> Manifest:
    """The manifest with its annotation."""
    metadata = manifest["metadata"]
    annotations = {**metadata.get("annotations", {}), APPLIED_ANNOTATION: digest}
    return {**manifest, "metadata": {**metadata, "annotations": annotations}}


def mark_of(body: Mapping[str, Any]) -> str:
    """What the annotation of an object says; "" when it has none."""
    mark: str = body["metadata"].get("annotations", {}).get(APPLIED_ANNOTATION, "")
    return mark
