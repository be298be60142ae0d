"""YAML that somebody else wrote: read without what makes a small file mean billions of values."""

from __future__ import annotations

from typing import Any

import yaml

LARGEST_BYTES = 256 * 1024
"""Files of profiles and contexts have a few kilobytes."""
_LONGEST_REASON = 300


class NotPlain(ValueError):
    """It is not YAML, or not as plain as it has to be; the message says what it is, in one line."""


class _Loader(yaml.SafeLoader):
    """Without aliases: nine of them in a row mean a billion values."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]  # the stubs do not say
            raise yaml.MarkedYAMLError(problem="write it out in place of an alias (*name)", problem_mark=mark)
        return super().compose_node(parent, index)


def load_plain(data: bytes) -> Any:
    """The one document of a file.

    Raises:
        NotPlain: it is larger than `LARGEST_BYTES`, has aliases, or is no YAML in UTF-8.
    """
    if len(data) > LARGEST_BYTES:
        raise NotPlain(f"is larger than {LARGEST_BYTES // 1024} KiB")
    try:
        return yaml.load(data.decode(), _Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: no UTF-8, or a date that is none
        raise NotPlain(f"is not YAML: {' '.join(str(error).split())[:_LONGEST_REASON]}") from error
