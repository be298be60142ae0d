"""Energy profiles: what actions cost an aircraft, and tasks an edge machine.

A reference is the name of a built-in profile (`fleet/energy/profiles.yaml`), or `path/to/file.yaml#name`.
"""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from fleet.errors import Problem, SpecError
from fleet.plain_yaml import LARGEST_BYTES, NotPlain, load_plain

BUILT_IN = "built-in profiles"
_Finite = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_Above = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_Profile = TypeVar("_Profile", bound=BaseModel)


class _Part(BaseModel):
    """A part of a profile: immutable, and no unknown fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Task(_Part):
    """Something that takes power for a time.

    Args:
        power_w: Mean power, in W.
        time_s: Duration, in s.
        sd: Standard deviation of the power; not used.
    """

    power_w: _Finite
    time_s: _Finite
    sd: _Finite | None = None

    @property
    def energy_j(self) -> float:
        """Power times time, in J."""
        return self.power_w * self.time_s


class Draw(_Part):
    """Power that is drawn as long as a state lasts, in W."""

    power_w: _Finite
    time_s: _Finite | None = None
    sd: _Finite | None = None


class Battery(_Part):
    """A full battery, at its nominal voltage."""

    capacity_mah: _Above
    voltage_v: _Above

    @property
    def energy_j(self) -> float:
        """Energy of the full battery, in J."""
        return self.capacity_mah * 3.6 * self.voltage_v


class AircraftProfile(_Part):
    """What an aircraft's actions cost; a move is one cell.

    Source: boubinjg/SoftwarePilot, energy models.
    """

    name: str = ""
    battery: Battery
    forward: Task
    backward: Task
    left: Task
    right: Task
    takeoff: Task
    land: Task
    capture: Task
    hover: Draw
    up: Task | None = None
    down: Task | None = None
    gimbal: Task | None = None
    waypoint: Task | None = None


class EdgeProfile(_Part):
    """What an edge machine's tasks cost: powers are those of the whole machine, idle power included.

    Args:
        decide: One choice of an action; the source calls it `knn`, after its model.
        busy: Power under full load; that of the hungriest task when the file has none.

    Source: boubinjg/SoftwarePilot, energy models.
    """

    name: str = ""
    send_image: Task
    extract_features: Task
    decide: Task = Field(validation_alias=AliasChoices("decide", "knn"))
    idle: Draw
    busy: Draw | None = None
    astar: Task | None = None

    @property
    def busy_w(self) -> float:
        """Power under full load, in W."""
        if self.busy is not None:
            return self.busy.power_w
        return max(self.send_image.power_w, self.extract_features.power_w, self.decide.power_w)

    @property
    def state_s(self) -> float:
        """Time from a taken picture to the chosen action, in s."""
        return self.send_image.time_s + self.extract_features.time_s + self.decide.time_s


def load_aircraft(reference: str, folder: Path | None = None) -> AircraftProfile:
    """Read an aircraft's profile.

    Args:
        reference: A built-in name, or `path/to/file.yaml#name`.
        folder: What a relative path starts from; the working directory when left out.

    Raises:
        SpecError: there is no such profile, or it is not a good one; says what to write instead.
    """
    return _validated(AircraftProfile, reference, *_find("aircraft", reference, folder))


def load_edge(reference: str, folder: Path | None = None) -> EdgeProfile:
    """Read an edge machine's profile; see `load_aircraft`."""
    return _validated(EdgeProfile, reference, *_find("edge", reference, folder))


def built_in(section: str) -> tuple[str, ...]:
    """Names of the built-in profiles of a section: `aircraft` or `edge`."""
    return tuple(_built_in_document()[section])


@cache
def _built_in_document() -> Mapping[str, Any]:
    document: Mapping[str, Any] = load_plain((resources.files("fleet.energy") / "profiles.yaml").read_bytes())
    return document


def _find(section: str, reference: str, folder: Path | None) -> tuple[str, Any]:
    """The profile's name and what its document says of it."""
    path, mark, name = reference.rpartition("#")
    if mark and not (path and name):
        raise SpecError([Problem("", f"{reference!r} is not a profile", "write path/to/file.yaml#name")])
    if not mark and Path(name).suffix in {".yaml", ".yml"}:
        raise SpecError([Problem("", f"{reference!r} names a file but no profile in it", f"write {name}#name")])
    document = _read(path, folder) if mark else _built_in_document()
    return name, _pick(document, section, name, path or BUILT_IN)


def _read(path: str, folder: Path | None) -> Any:
    file = (folder or Path()) / path
    try:
        with file.open("rb") as opened:
            return load_plain(opened.read(LARGEST_BYTES + 1))
    except OSError as error:
        hint = "give the path of a YAML file with `aircraft` and `edge` profiles"
        raise SpecError([Problem(path, f"cannot be read: {error.strerror or error}", hint)], path) from error
    except NotPlain as error:
        raise SpecError([Problem(path, str(error))], path) from error


def _pick(document: Any, section: str, name: str, where: str) -> Any:
    profiles = document.get(section) if isinstance(document, Mapping) else None
    if not isinstance(profiles, Mapping) or not profiles:
        hint = f"write `{section}:` and under it a profile by name"
        raise SpecError([Problem(section, f"{where} has no {section} profiles", hint)], where)
    if name not in profiles:
        names = [str(known) for known in profiles]
        close = get_close_matches(name, names, n=1)
        hint = f"did you mean {close[0]}?" if close else "it has " + ", ".join(names)
        raise SpecError([Problem(section, f"{where} has no {section} profile {name!r}", hint)], where)
    return profiles[name]


def _validated(kind: type[_Profile], reference: str, name: str, fields: Any) -> _Profile:
    if not isinstance(fields, Mapping):
        raise SpecError([Problem(name, "is not a profile", "give it fields such as `idle: {power_w: 2.5}`")], reference)
    try:
        return kind.model_validate({**fields, "name": name})
    except ValidationError as error:
        raise SpecError([_problem(name, detail) for detail in error.errors()], reference) from error


def _problem(name: str, detail: Any) -> Problem:
    path = ".".join([name, *(str(part) for part in detail["loc"])])
    match detail["type"]:
        case "missing":
            return Problem(path, "is missing", "tasks are written {power_w: 12.5, time_s: 1.0}")
        case "extra_forbidden":
            return Problem(path, "is not a field of a profile", "remove it, or correct its name")
        case _:
            given = reprlib.repr(detail["input"])
            return Problem(path, f"{detail['msg'][:1].lower()}{detail['msg'][1:]}, not {given}")
