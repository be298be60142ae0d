"""Autonomy cubes: places on a grid, completely explored on one or more dates.

Source: paper, table 1 and Boubin et al. 2019 (autonomy cubes as execution contexts).
"""

from __future__ import annotations

import hashlib
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import ContextKind, Environment, Media, Observation
from fleet.contexts.cells import CubeContent, examine, grid_of, has_data, pictured_exg
from fleet.contexts.grid import Grid
from fleet.contexts.manifest import BrokenContext, CubeManifest, PictureKind
from fleet.contexts.render import DEFAULT_BRIGHTNESS, DEFAULT_TINT, RENDER_VERSION, Appearance, render
from fleet.errors import ContextError


class AutonomyCube:
    """A context on a grid; see docs/contexts.md.

    Args:
        content: What the cube holds.
        date: The date that is observed; the last one with data when left out.

    Attributes:
        date: The date that is observed.
        observed: All dates with data.

    Raises:
        BrokenContext: the content is not a good context; has every problem at once.
        ContextError: nothing was observed on the date.
    """

    def __init__(self, content: CubeContent, date: str | None = None) -> None:
        problems = examine(content).problems
        if problems:
            raise BrokenContext(content.manifest.name, problems)
        self._content = content
        self.observed: tuple[str, ...] = tuple(sorted(set(content.cells.dates[has_data(content)].tolist())))
        self.date = self.observed[-1] if date is None else date
        if self.date not in self.observed:
            raise ContextError(
                f"{content.manifest.name} has nothing of {self.date}; it was observed on {', '.join(self.observed)}"
            )
        self._entries = np.flatnonzero(content.cells.dates == self.date)

    @property
    def kind(self) -> ContextKind:
        """Autonomy cube."""
        return ContextKind.AUTONOMY_CUBE

    @property
    def manifest(self) -> CubeManifest:
        """What the cube says of itself."""
        return self._content.manifest

    @property
    def content(self) -> CubeContent:
        """What the cube holds, of all dates."""
        return self._content

    @property
    def renders(self) -> bool:
        """Whether any observation of this date has a picture that is drawn and not taken."""
        return any(not self._stored.get(int(cell)) for cell in np.flatnonzero(self.environment.grid.valid))

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user of the context should be told."""
        if not self.renders:
            return ()
        shown = "excess green"
        if self.manifest.render is not None:
            scale = self.manifest.render
            shown = f"{scale.feature} as excess green, 0 at {scale.low:g} and 100 at {scale.high:g}"
        return (f"{self.manifest.name}: pictures are drawn from measured features, they show {shown}",)

    def at(self, date: str) -> AutonomyCube:
        """The same cube on another of its dates."""
        return AutonomyCube(self._content, date)

    @cached_property
    def environment(self) -> Environment:
        """Grid, name, digest and truth.

        The truth is in the unit that Map() sees. Where `render` scales the truth to excess green, it is the excess
        green of the pictures, called `exg`; the scale goes through zero, so classes relative to the mean are the same.
        """
        spec = self.manifest.grid
        valid = np.zeros((spec.rows, spec.columns), dtype=np.bool_)
        states = self._entries[has_data(self._content)[self._entries]]
        cells = self._content.cells
        valid[cells.rows[states], cells.columns[states]] = True
        grid = Grid(valid, spec.cell_height_m, spec.cell_width_m, spec.rows_go_south, spec.columns_go_east)
        truth_name, truth = self._truth()
        return Environment(self.manifest.name, self._digest(), grid, truth_name, truth)

    def values(self, feature: str) -> NDArray[np.float64]:
        """A measured feature in its own unit, [rows, columns], NaN where there is none.

        Raises:
            ContextError: the cube has no such feature.
        """
        if feature not in self.manifest.feature_names:
            raise ContextError(f"{self.manifest.name} has no feature {feature!r}; it has {self._feature_list()}")
        return self._on_grid(self._content.cells.features[feature])

    def observe(self, state: int) -> Observation:
        """What a sensor would observe in a state: the stored pictures, else one that is drawn from the features.

        The attribute `rendered` is 1 when the picture is drawn; features that are attributes come beside it.

        Raises:
            ContextError: the state has no data.
        """
        grid = self.environment.grid
        if not 0 <= state < grid.cells:
            raise ContextError(f"{self.manifest.name} has states 0 to {grid.cells - 1}; {state} is none of them")
        row, column = grid.position(state)
        if not grid.valid[row, column]:
            raise ContextError(f"{self.manifest.name} has no data in row {row}, column {column} ({self.date})")
        entry = self._entry_of[state]
        stored = self._stored.get(state)
        media = tuple(self._content.pictures.media[i] for i in stored) if stored and self._content.pictures else ()
        attributes = {**self._attributes(entry), "rendered": 0.0 if media else 1.0}
        return Observation(state, f"row {row}, column {column}", media or (self._drawn(entry),), attributes)

    @cached_property
    def _entry_of(self) -> dict[int, int]:
        cells = self._content.cells
        states = cells.rows[self._entries] * self.manifest.grid.columns + cells.columns[self._entries]
        return dict(zip(states.tolist(), self._entries.tolist(), strict=True))

    @cached_property
    def _stored(self) -> dict[int, list[int]]:
        """Indices of the stored pictures of each state on this date."""
        found: dict[int, list[int]] = {}
        pictures = self._content.pictures
        if pictures is None or self.manifest.pictures is PictureKind.RENDERED:
            return found
        for index in np.flatnonzero(pictures.dates == self.date).tolist():
            state = int(pictures.rows[index]) * self.manifest.grid.columns + int(pictures.columns[index])
            found.setdefault(state, []).append(index)
        return found

    @cached_property
    def _exg(self) -> NDArray[np.float64]:
        return pictured_exg(self._content)

    def _truth(self) -> tuple[str, NDArray[np.float64] | None]:
        name, render_scale = self.manifest.truth, self.manifest.render
        if name is None:
            return "", None
        if render_scale is not None and render_scale.feature == name and self.renders_truth:
            return "exg", self._on_grid(self._exg)
        return name, self.values(name)

    @property
    def renders_truth(self) -> bool:
        """Whether pictures are drawn from the truth by the manifest's scale."""
        scale = self.manifest.render
        return (
            self.manifest.pictures is PictureKind.RENDERED
            and scale is not None
            and scale.feature == self.manifest.truth
        )

    def _digest(self) -> str:
        parts = (self._content.digest(), self.date, RENDER_VERSION)
        return hashlib.blake2b("/".join(parts).encode(), digest_size=16).hexdigest()

    def _on_grid(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        cells, entries = self._content.cells, self._entries
        return grid_of(values[entries], cells.rows[entries], cells.columns[entries], self.manifest.grid)

    def _attributes(self, entry: int) -> dict[str, float]:
        values = {
            feature.name: float(self._content.cells.features[feature.name][entry])
            for feature in self.manifest.features
            if feature.attribute
        }
        return {name: value for name, value in values.items() if np.isfinite(value)}

    def _drawn(self, entry: int) -> Media:
        cells = self._content.cells
        red, blue = self._measured("saturation_red", entry, 0.0), self._measured("saturation_blue", entry, 0.0)
        tint = (red - blue) * 255.0 if red and blue else DEFAULT_TINT
        brightness = self._measured("brightness", entry, DEFAULT_BRIGHTNESS)
        seed = int(cells.rows[entry]) * self.manifest.grid.columns + int(cells.columns[entry])
        return render(Appearance(float(self._exg[entry]), brightness, tint, seed))

    def _measured(self, feature: str, entry: int, default: float) -> float:
        values = self._content.cells.features.get(feature)
        if values is None or not np.isfinite(values[entry]):
            return default
        return float(values[entry])

    def _feature_list(self) -> str:
        return ", ".join(self.manifest.feature_names) or "none"
