"""Which addresses the operator opens for those who write FleetSpecs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePosixPath
from urllib.parse import unquote, urlsplit

from fleet.errors import Problem, SpecError
from fleet.spec.resources import FleetSpec
from fleet.storage.webhdfs_address import PORT

_EXAMPLE = f"webhdfs://user@namenode:{PORT}/folder"


@dataclass(frozen=True)
class Reach:
    """How far addresses of FleetSpecs may lead.

    Args:
        own: The installation's own storage, which is always open to them.
        hosts: Hosts that they may name beside it: `name`, `name:port` or `*.domain`; none means any.
    """

    own: str
    hosts: tuple[str, ...] = ()

    def check(self, uri: str, place: str = "storage.uri") -> None:
        """Let an address pass.

        Raises:
            SpecError: it leads where it may not; says what to write instead.
        """
        problem = self._problem(uri, place)
        if problem is not None:
            raise SpecError([problem])

    def problems(self, spec: FleetSpec) -> list[Problem]:
        """What is wrong with the addresses of a FleetSpec that the operator opens."""
        named = {f"spec.contexts[{index}].uri": each.uri for index, each in enumerate(spec.spec.contexts)}
        named["spec.storage.uri"] = spec.spec.storage.uri or ""
        found = (self._problem(uri, place) for place, uri in named.items() if "://" in uri)
        return [problem for problem in found if problem is not None]

    def _problem(self, uri: str, place: str) -> Problem | None:
        try:
            scheme = urlsplit(uri).scheme
        except ValueError as error:  # half of an IPv6 address
            return Problem(place, f"{uri} is no address: {error}", f"write {_EXAMPLE}")
        if scheme == "file":
            return self._outside(uri, place)
        strange = next((host for host in _hosts(uri) if not self._allows(host)), None)
        if strange is None or not self.hosts:
            return None
        allowed = ", ".join([*_hosts(self.own), *self.hosts])
        return Problem(place, f"{strange} is no host that this installation opens", f"it opens {allowed}")

    def _outside(self, uri: str, place: str) -> Problem | None:
        """A folder is one of the operator's own machine: only what the installation has mounted for this counts."""
        own = urlsplit(self.own)
        if own.scheme != "file":
            return Problem(place, f"{uri} is a folder, and no volume holds it", f"leave it out, or write {_EXAMPLE}")
        folder, root = (PurePosixPath(unquote(urlsplit(each).path)) for each in (uri, self.own))
        if ".." in folder.parts or not folder.is_relative_to(root):
            return Problem(
                place, f"no volume holds the folder {folder}", f"leave it out, or write one below {self.own}"
            )
        return None

    def _allows(self, host: str) -> bool:
        return host in _hosts(self.own) or any(_fits(host, allowed) for allowed in self.hosts)


def _hosts(uri: str) -> Iterator[str]:
    """Each `host:port` of an address."""
    for host in urlsplit(uri).netloc.rpartition("@")[2].lower().split(","):
        if host:
            name, port = _parts(host)
            yield f"{name}:{port or PORT}"


def _fits(host: str, allowed: str) -> bool:
    (name, port), (wanted, wanted_port) = _parts(host), _parts(allowed)
    fits = name.endswith(wanted.removeprefix("*")) if wanted.startswith("*.") else name == wanted
    return fits and wanted_port in ("", port)


def _parts(host: str) -> tuple[str, str]:
    """Name and port; "" when it names none."""
    name, _, port = host.rpartition(":")
    return (name, port) if name and port.isdecimal() else (host, "")
