"""Where numba finds the kernels that were compiled with the image."""

import tempfile
from pathlib import Path
from typing import Any

from kernel_settings import FOLDER
from numba.core.caching import UserWideCacheLocator


class Locator(UserWideCacheLocator):  # type: ignore[misc]  # numba has no types
    """The user's own cache, which gets copies first: numba wants to write where it reads."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """A locator for functions of a file's folder; None where nothing is prebuilt: numba's own locators serve it."""
        prebuilt = Path(FOLDER) / cls.get_suitable_cache_subpath(py_file)
        if not prebuilt.is_dir():
            return None
        locator = super().from_function(py_func, py_file)
        if locator is not None:
            for source in sorted(prebuilt.iterdir()):
                _copy(source, Path(locator.get_cache_path()) / source.name)
        return locator


def _copy(source: Path, target: Path) -> None:
    """All at once: another process of the pod may be reading."""
    if target.exists():
        return
    with tempfile.NamedTemporaryFile(dir=target.parent, delete=False) as draft:
        draft.write(source.read_bytes())
    Path(draft.name).rename(target)
