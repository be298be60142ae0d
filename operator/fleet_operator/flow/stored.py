"""The FleetSpec and its functions as they are in storage: what a mission that was ordered is flown with."""

from __future__ import annotations

import base64
import hashlib
import json
from dataclasses import dataclass
from typing import Any

from fleet.errors import ObjectNotFound, SpecError, StorageError
from fleet.spec.base import GROUP, Metadata
from fleet.spec.resources import Fleet, FleetSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage
from fleet_operator.compiler.bundle import Bundle

FUNCTIONS_ANNOTATION = f"{GROUP}/functions"
"""On the FleetSpec in storage: the hash of the functions that it was ordered with."""
REPLACED_ANNOTATION = f"{GROUP}/replaced-functions"
"""The hash of those before; their ConfigMap is no longer wanted."""
_DIGITS = 16
_NEUTRAL: dict[str, Any] = {"missions": {"count", "interval"}, "storage": {"on_delete"}, "suspend": True}
"""What may change without anything being made anew."""


@dataclass(frozen=True)
class Flown:
    """A FleetSpec together with the functions that its pods are given."""

    spec: FleetSpec
    bundle: Bundle

    @property
    def fleet(self) -> Fleet:
        """`spec` of the FleetSpec."""
        return self.spec.spec

    @property
    def digest(self) -> str:
        """Hash of all that decides what pods of it do."""
        text = self.fleet.model_dump_json(exclude=_NEUTRAL)
        return hashlib.blake2b(f"{text}\n{self.bundle.digest}".encode(), digest_size=_DIGITS // 2).hexdigest()


def write_flown(storage: Storage, paths: FleetPaths, flown: Flown, before: FleetSpec | None) -> FleetSpec:
    """Keep a FleetSpec and its functions; its presence means that everything that it names is there.

    Args:
        before: What is there now.

    Returns:
        The FleetSpec as it is in storage now.

    Raises:
        StorageError: the storage refuses.
    """
    spec = kept_form(flown, before)
    if spec == before:
        return spec
    files = {path: base64.b64encode(data).decode() for path, data in sorted(flown.bundle.files.items())}
    storage.write(paths.functions, json.dumps({"digest": flown.bundle.digest, "files": files}).encode())
    document = spec.model_dump_json(by_alias=True, indent=1, exclude_none=True)
    storage.write(paths.fleet_spec, document.encode())
    return spec


def read_spec(storage: Storage, paths: FleetPaths) -> FleetSpec | None:
    """The FleetSpec in storage; None when there is none.

    User code can write there, so what it says of its own name counts for nothing: it is that of its folder.

    Raises:
        StorageError: it cannot be read.
    """
    try:
        spec = FleetSpec.model_validate(json.loads(storage.read(paths.fleet_spec)))
    except ObjectNotFound:
        return None
    except (ValueError, RecursionError) as error:
        told = " ".join(str(error).split())[:200]
        raise StorageError(f"{paths.fleet_spec} in {storage.uri} is no FleetSpec of this version: {told}") from error
    metadata = spec.metadata.model_copy(update={"name": paths.fleet, "namespace": paths.namespace})
    return spec.model_copy(update={"metadata": metadata})


def read_functions(storage: Storage, paths: FleetPaths, spec: FleetSpec) -> Bundle | None:
    """The functions that the FleetSpec in storage was kept with; None when they are not there (any more).

    Raises:
        StorageError: they cannot be read, or no ConfigMap could carry them.
    """
    try:
        document = json.loads(storage.read(paths.functions))
        bundle = Bundle({path: base64.b64decode(data) for path, data in document["files"].items()})
    except ObjectNotFound:
        return None
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, SpecError) as error:
        told = " ".join(str(error).split())[:200]
        where = f"{paths.functions} in {storage.uri}"
        raise StorageError(f"{where} is damaged: {told}; restore it, or delete it") from error
    return bundle if bundle.digest == functions_of(spec) else None


def functions_of(spec: FleetSpec) -> str:
    """Hash of the functions of a FleetSpec in storage; "" when it was put there by `fleet run`."""
    return spec.metadata.annotations.get(FUNCTIONS_ANNOTATION, "")


def replaced_functions(spec: FleetSpec) -> str:
    """Hash of the functions that those of the FleetSpec in storage took the place of; "" when there are none."""
    return spec.metadata.annotations.get(REPLACED_ANNOTATION, "")


def kept_form(flown: Flown, before: FleetSpec | None) -> FleetSpec:
    """The FleetSpec with only that of its metadata which does not change by itself."""
    digest = flown.bundle.digest
    annotations = {FUNCTIONS_ANNOTATION: digest}
    replaced = "" if before is None else functions_of(before)
    if before is not None and replaced == digest:
        replaced = replaced_functions(before)
    if replaced:
        annotations[REPLACED_ANNOTATION] = replaced
    metadata = flown.spec.metadata
    kept = Metadata(name=metadata.name, namespace=metadata.namespace, uid=metadata.uid, annotations=annotations)
    return FleetSpec(metadata=kept, spec=flown.fleet)


def renewed(ordered: FleetSpec, live: FleetSpec) -> FleetSpec:
    """The FleetSpec of a mission that was ordered, with that of the live one which helps pods that could not start.

    These are images and amounts: they change no result. Whatever runs already is left alone.
    """
    old, new = ordered.spec, live.spec
    functions = {
        name: was.model_copy(
            update={"resources": now.resources} | ({"image": now.image, "command": now.command} if was.image else {})
        )
        for name, was, now in (("map", old.map, new.map), ("eval", old.eval, new.eval))
        if bool(was.image) == bool(now.image)
    }
    fleet = old.model_copy(
        update={
            **functions,
            "aggregation": old.aggregation.model_copy(update={"resources": new.aggregation.resources}),
            "workflow": old.workflow.model_copy(
                update={
                    name: getattr(new.workflow, name) for name in ("resources", "sensor_resources", "trainer_resources")
                }
            ),
            "missions": old.missions.model_copy(update={"agent_retries": new.missions.agent_retries}),
        }
    )
    return ordered.model_copy(update={"spec": fleet})
