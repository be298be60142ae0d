"""The files that stand beside a FleetSpec, on their way through ConfigMaps into the operator.

A ConfigMap with files has the label `fleetcomputer.io/files: FLEET` and the annotation `fleetcomputer.io/paths`, which
is JSON from its keys to paths relative to the FleetSpec. A file that is too large for one ConfigMap is cut: the paths
of its pieces end in `#2/3`. ConfigMaps that were made together say so in `fleetcomputer.io/set`: an older one that is
left over does not count.
"""

from __future__ import annotations

import base64
import binascii
import errno
import hashlib
import json
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from fleet.contexts.manifest import MANIFEST
from fleet.contexts.tables import FEATURES, PICTURES
from fleet.errors import Problem, SpecError, StorageUnavailable
from fleet.spec.base import GROUP
from fleet.spec.resources import FleetSpec
from fleet_operator.flow.sources import read_bundle
from fleet_operator.resources import names

Manifest = dict[str, Any]
LARGEST_BYTES = 900 * 1024
"""A ConfigMap holds 1 MiB with everything around it (Kubernetes, "ConfigMaps": motivation)."""
SET_ANNOTATION = f"{GROUP}/set"
_PIECE = re.compile(r"(?P<path>.+)#(?P<number>[0-9]{1,6})/(?P<count>[0-9]{1,6})")
_LONGEST_NAME_BYTES, _LONGEST_PATH_BYTES = 255, 1024
_NO_ROOM = {errno.ENOSPC, errno.EDQUOT}


def collect(spec: FleetSpec, folder: Path) -> dict[str, bytes]:
    """Everything that a FleetSpec names beside it, by path: functions, profiles, a model, contexts.

    Raises:
        SpecError: something is not there, or is not below the folder.
    """
    problems = outside(spec)
    if problems:
        raise SpecError(problems)
    files = dict(read_bundle(spec.spec, folder).files)
    for context in spec.spec.contexts:
        if "://" in context.uri:
            continue
        for name in (MANIFEST, FEATURES, PICTURES):
            file = folder / context.uri / name
            if file.is_file():
                files[file.relative_to(folder).as_posix()] = file.read_bytes()
    return files


def outside(spec: FleetSpec) -> list[Problem]:
    """Names of the FleetSpec that lead out of its folder: in a cluster there is nothing around it."""
    either = {f"spec.contexts[{index}].uri": each.uri for index, each in enumerate(spec.spec.contexts)}
    either["spec.sa.pretrained"] = spec.spec.sa.pretrained or ""
    named = {place: path for place, path in either.items() if "://" not in path}
    named["spec.agents.energyProfile"] = _file_of_profile(spec.spec.agents.energy_profile)
    named["spec.workflow.edgeProfile"] = _file_of_profile(spec.spec.workflow.edge_profile)
    return [
        Problem(place, f"{path} is not below the folder of the FleetSpec", "copy it there, or write a storage address")
        for place, path in named.items()
        if path and not _is_inside(path)
    ]


def to_config_maps(fleet: str, files: Mapping[str, bytes]) -> list[Manifest]:
    """ConfigMaps that carry files, without a namespace; the same files give the same ConfigMaps."""
    pieces = [piece for path in sorted(files) for piece in _pieces(path, files[path])]
    parts: list[list[tuple[str, bytes]]] = []
    for path, data in pieces:
        if not parts or sum(len(each) for _, each in parts[-1]) + len(data) > LARGEST_BYTES:
            parts.append([])
        parts[-1].append((path, data))
    digest = hashlib.blake2b(repr(pieces).encode(), digest_size=8).hexdigest()
    return [
        _config_map(fleet, names.files(fleet, number), f"{digest} {len(parts)}", part)
        for number, part in enumerate(parts, start=1)
    ]


def from_config_maps(manifests: Sequence[Mapping[str, Any]]) -> dict[str, bytes]:
    """The files that ConfigMaps carry.

    Raises:
        SpecError: an annotation is no JSON, a path leads out of the folder, or a piece of a file is missing.
    """
    whole: dict[str, bytes] = {}
    cut: dict[str, dict[int, bytes]] = {}
    counts: dict[str, int] = {}
    problems: list[Problem] = []
    for manifest in _newest(manifests, problems):
        where = f"ConfigMap {manifest['metadata']['name']}"
        for path, data in _entries(manifest, where, problems):
            piece = _PIECE.fullmatch(path)
            if piece is None:
                whole[path] = data
            else:
                cut.setdefault(piece["path"], {})[int(piece["number"])] = data
                counts[piece["path"]] = int(piece["count"])
    for path, found in cut.items():
        there = sorted(number for number in found if 0 < number <= counts[path])
        if len(there) < counts[path]:  # counted, not listed: whoever writes the path chooses the number
            text = f"{counts[path] - len(there)} of its {counts[path]} pieces are not there"
            problems.append(Problem(path, text, "apply all ConfigMaps of `fleet files`"))
        else:
            whole[path] = b"".join(found[number] for number in there)
    problems += _unplaceable(whole)
    if problems:
        raise SpecError(problems)
    return whole


def place(files: Mapping[str, bytes], folder: Path) -> None:
    """Write files into a folder.

    Raises:
        SpecError: a path leads out of the folder, or no file can have it; nothing is written outside.
        StorageUnavailable: this machine's own disk is full.
    """
    problems = _unplaceable(files)
    if problems:
        raise SpecError(problems)
    for path, data in files.items():
        file = folder / path
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        except OSError as error:
            if error.errno in _NO_ROOM:
                raise StorageUnavailable(f"no room for the files of the fleet in {folder}: {error.strerror}") from error
            raise SpecError([Problem(path, f"cannot be written as a file: {error.strerror}", "rename it")]) from error


def version_of(manifests: Sequence[Mapping[str, Any]]) -> str:
    """Changes whenever one of the ConfigMaps may have changed."""
    seen = [(each["metadata"].get("uid", ""), each["metadata"].get("resourceVersion", "")) for each in manifests]
    return hashlib.blake2b(repr(seen).encode(), digest_size=8).hexdigest()


def _entries(manifest: Mapping[str, Any], where: str, problems: list[Problem]) -> list[tuple[str, bytes]]:
    """Paths and contents of one ConfigMap."""
    try:
        paths = json.loads((manifest["metadata"].get("annotations") or {}).get(names.PATHS_ANNOTATION, "{}"))
        binary = {key: base64.b64decode(value) for key, value in (manifest.get("binaryData") or {}).items()}
    except (ValueError, binascii.Error, RecursionError):
        paths, binary = None, {}
    if not isinstance(paths, dict) or not all(isinstance(path, str) for path in paths.values()):
        problems.append(Problem(where, f"its annotation {names.PATHS_ANNOTATION} is not JSON from keys to paths"))
        return []
    content = {key: text.encode() for key, text in (manifest.get("data") or {}).items()} | binary
    problems += [
        Problem(where, f"it has no key {key}, which stands for {paths[key]}") for key in paths.keys() - content
    ]
    return [(paths[key], content[key]) for key in paths.keys() & content]


def _pieces(path: str, data: bytes) -> list[tuple[str, bytes]]:
    if len(data) <= LARGEST_BYTES:
        return [(path, data)]
    cuts = [data[start : start + LARGEST_BYTES] for start in range(0, len(data), LARGEST_BYTES)]
    return [(f"{path}#{number}/{len(cuts)}", cut) for number, cut in enumerate(cuts, start=1)]


def _newest(manifests: Sequence[Mapping[str, Any]], problems: list[Problem]) -> list[Mapping[str, Any]]:
    """Those of the set that the first by name belongs to, and those of none."""
    found = [((each["metadata"].get("annotations") or {}).get(SET_ANNOTATION, ""), each) for each in manifests]
    found.sort(key=lambda each: str(each[1]["metadata"]["name"]))
    first = next((mark for mark, _ in found if mark), "")
    there = sum(mark == first for mark, _ in found)
    count = int(first.partition(" ")[2]) if first.partition(" ")[2].isdecimal() else there
    if there < count:
        text = f"{there} of {count} ConfigMaps with the files of the FleetSpec are there"
        problems.append(Problem("", text, "apply all that `fleet files` prints"))
    return [each for mark, each in found if mark in ("", first)]


def _config_map(fleet: str, name: str, together: str, part: Sequence[tuple[str, bytes]]) -> Manifest:
    paths: dict[str, str] = {}
    content: dict[str, dict[str, str]] = {"data": {}, "binaryData": {}}
    for index, (path, data) in enumerate(part):
        key = f"{index:03d}-{re.sub(r'[^A-Za-z0-9._-]', '.', path)[-200:]}"
        paths[key] = path
        text = _text(data)
        if text is None:
            content["binaryData"][key] = base64.b64encode(data).decode()
        else:
            content["data"][key] = text
    return {
        "apiVersion": "v1",
        "kind": "ConfigMap",
        "metadata": {
            "name": name,
            "labels": {
                "app.kubernetes.io/name": names.PRODUCT,
                "app.kubernetes.io/instance": fleet,
                "app.kubernetes.io/part-of": names.PRODUCT,
                names.FILES_LABEL: names.label_value(fleet),
            },
            "annotations": {names.PATHS_ANNOTATION: json.dumps(paths, sort_keys=True), SET_ANNOTATION: together},
        },
        **{kind: entries for kind, entries in content.items() if entries},
    }


def _text(data: bytes) -> str | None:
    try:
        return data.decode()
    except UnicodeDecodeError:
        return None


def _file_of_profile(reference: str) -> str:
    path, mark, _ = reference.partition("#")
    return path if mark else ""


def _unplaceable(paths: Collection[str]) -> list[Problem]:
    """Paths that lead out of their folder, that no file can have, or that use another file as a folder."""
    problems = [Problem(path, "leads out of the folder of the FleetSpec") for path in paths if not _is_inside(path)]
    for path in paths:
        parents = {parent.as_posix() for parent in PurePosixPath(path).parents}
        taken = next((other for other in parents if other in paths), None)
        if not _is_name(path):
            problems.append(Problem(repr(path[:80]), "is no name that a file can have", "rename it"))
        elif taken is not None:
            problems.append(Problem(path, f"{taken} is a file, and not the folder of {path}", "rename one of them"))
    return problems


def _is_inside(path: str) -> bool:
    return not PurePosixPath(path).is_absolute() and ".." not in PurePosixPath(path).parts


def _is_name(path: str) -> bool:
    """Whether a file can have this path: it is what it says (`a//b` and `./b` are b), and not too long."""
    parts = path.removeprefix("/").split("/")
    return (
        path.isprintable()  # neither NUL nor half a character
        and all(part not in ("", ".") and len(part.encode()) <= _LONGEST_NAME_BYTES for part in parts)
        and len(path.encode()) <= _LONGEST_PATH_BYTES
    )
