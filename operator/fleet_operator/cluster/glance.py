"""Reading only the first lines of an object, where its name and version are.

A Job is 8 KB of JSON. The operator hears of each one that it makes twice: by the answer, and by its watch. To read
both whole is a fifth of what making a Job costs it. The API server writes built-in objects in the order of their fields
(apimachinery, ObjectMeta); whatever does not look like that is read whole.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from fleet_operator.resources.refs import ObjectRef

_HEAD = (
    rb'\{"kind":"\w+","apiVersion":"[^"]+","metadata":\{"name":"([^"\\]+)","namespace":"([^"\\]+)",'
    rb'"uid":"([^"\\]+)","resourceVersion":"(\d+)",(?:"generation":\d+,)?"creationTimestamp":"([^"\\]+)"'
)
_OBJECT = re.compile(_HEAD)
_EVENT = re.compile(rb'\{"type":"(?:ADDED|MODIFIED)","object":' + _HEAD)


@dataclass(frozen=True, slots=True)
class Head:
    """The beginning of an object.

    Args:
        version: Its resourceVersion.
        created: Its creationTimestamp.
    """

    ref: ObjectRef
    uid: str
    version: str
    created: str


def head_of_object(content: bytes) -> Head | None:
    """The head of an object of a namespace; None when it cannot be told at a glance."""
    return _head(_OBJECT.match(content))


def head_of_event(line: bytes) -> Head | None:
    """The head of the object that a watch says was added or changed; None when it cannot be told at a glance."""
    return _head(_EVENT.match(line))


def _head(match: re.Match[bytes] | None) -> Head | None:
    if match is None:
        return None
    name, namespace, uid, version, created = (part.decode() for part in match.groups())
    return Head(ObjectRef(namespace, name), uid, version, created)
