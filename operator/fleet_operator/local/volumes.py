"""Volumes of pods as folders of the run: ConfigMaps as files, empty folders that vanish with their pod."""

from __future__ import annotations

import base64
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fleet_operator.local.workloads import ConfigMapVolume, Job, UnsupportedManifest


@dataclass
class Volumes:
    """Folders below one root.

    Args:
        root: Made when needed; what another run left there is removed.
    """

    root: Path
    _config_maps: dict[str, dict[str, bytes]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.remove()

    def add_config_map(self, manifest: Mapping[str, Any]) -> None:
        """Remember the entries of a ConfigMap."""
        text = {key: value.encode() for key, value in manifest.get("data", {}).items()}
        binary = {key: base64.b64decode(value) for key, value in manifest.get("binaryData", {}).items()}
        self._config_maps[manifest["metadata"]["name"]] = {**text, **binary}

    def folders(self, job: Job, pod: int) -> dict[str, Path]:
        """The folder of each volume of a Job's pod, made and filled.

        Args:
            pod: Number of the pod; no two pods of a run have the same.

        Raises:
            UnsupportedManifest: a ConfigMap was not applied.
        """
        folders = {}
        for name, volume in job.volumes.items():
            if volume is None:
                folders[name] = self._empty(job, pod) / name
                folders[name].mkdir(parents=True, exist_ok=True)
            else:
                folders[name] = self._filled(job, volume)
        return folders

    def forget(self, job: Job, pod: int) -> None:
        """Remove the empty folders of a pod that has ended."""
        shutil.rmtree(self._empty(job, pod), ignore_errors=True)

    def remove(self) -> None:
        """Remove everything."""
        shutil.rmtree(self.root, ignore_errors=True)

    def _empty(self, job: Job, pod: int) -> Path:
        return self.root / "pods" / f"{job.name}-{pod}"

    def _filled(self, job: Job, volume: ConfigMapVolume) -> Path:
        """All pods share the folder of a ConfigMap, as its name has a hash of its content."""
        if volume.config_map not in self._config_maps:
            raise UnsupportedManifest(f"Job {job.name}: the ConfigMap {volume.config_map} was not applied")
        folder = self.root / "config-maps" / volume.config_map
        for key, path in volume.paths.items():
            file = folder / path
            if not file.exists():
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(self._config_maps[volume.config_map][key])
        return folder
