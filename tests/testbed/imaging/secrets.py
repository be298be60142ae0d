"""How this computer reaches package registries, handed to a build as secrets: nothing of it is in an image."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

_BUNDLES = ("PIP_CERT", "REQUESTS_CA_BUNDLE", "SSL_CERT_FILE")
_SYSTEM_BUNDLE = Path("/etc/ssl/certs/ca-certificates.crt")
_MAVEN_SETTINGS = Path.home() / ".m2" / "settings.xml"
_LOCAL = ("cert", "client-cert", "cache-dir", "find-links", "require-virtualenv", "target", "user", "prefix", "log")
"""Keys of pip whose values are paths of this computer, or that would change what is installed."""


@contextmanager
def build_secrets() -> Iterator[Mapping[str, Path]]:
    """Files by the id under which the Containerfiles look for them; what is not on this computer is left out.

    `pip.conf`: pip's settings, with an index and its password if there is one. `ca.crt`: the authorities that this
    computer trusts. `settings.xml`: Maven's.
    """
    with tempfile.TemporaryDirectory() as folder:
        conf = Path(folder) / "pip.conf"
        conf.touch(mode=0o600)
        conf.write_text(_pip_conf(), encoding="utf-8")
        candidates = {"pip.conf": conf, "ca.crt": _bundle(), "settings.xml": _MAVEN_SETTINGS}
        yield {key: path for key, path in candidates.items() if path.is_file()}


def _bundle() -> Path:
    named = (Path(os.environ[name]) for name in _BUNDLES if os.environ.get(name))
    return next((path for path in named if path.is_file()), _SYSTEM_BUNDLE)


def _pip_conf() -> str:
    """The settings of pip here, whether they come from files or from the environment."""
    command = [sys.executable, "-m", "pip", "config", "list"]
    listed = subprocess.run(command, check=False, capture_output=True, text=True).stdout
    settings: dict[str, str] = {}
    for line in listed.splitlines():
        name, _, value = line.partition("=")
        section, _, key = name.rpartition(".")
        if section.strip(":") in {"global", "env", "install"} and key not in _LOCAL:
            settings[key] = value.strip("'\"")
    return "[global]\n" + "".join(f"{key} = {value}\n" for key, value in sorted(settings.items()))
