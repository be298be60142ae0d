"""Keys and certificates of a control plane, made by openssl."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from tests.testbed.processes import run

DAYS = "3650"
CURVE = ("ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")


class Authority:
    """A certificate authority in a folder: `ca.crt`, `ca.key`, and what it signs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.certificate = folder / "ca.crt"
        self._key = folder / "ca.key"
        folder.mkdir(parents=True, exist_ok=True)
        if not self.certificate.exists():
            self._make()

    def _make(self) -> None:
        files: list[str | Path] = ["-keyout", self._key, "-out", self.certificate]
        run(["openssl", "req", "-x509", "-newkey", *CURVE, "-days", DAYS, "-subj", "/CN=fleet-testbed", *files])

    def sign_server(self, name: str, addresses: Sequence[str], names: Sequence[str]) -> tuple[Path, Path]:
        """Certificate and key of a server that is reached by these addresses and names."""
        alternatives = [f"IP:{address}" for address in addresses] + [f"DNS:{one}" for one in names]
        extension = f"subjectAltName={','.join(alternatives)}\nextendedKeyUsage=serverAuth\n"
        return self._sign(name, f"/CN={name}", extension)

    def sign_client(self, user: str, groups: Sequence[str]) -> tuple[Path, Path]:
        """Certificate and key of a user of the API server."""
        subject = "".join(f"/O={_escaped(group)}" for group in groups) + f"/CN={_escaped(user)}"
        return self._sign(
            f"user-{hashlib.sha256(subject.encode()).hexdigest()[:16]}", subject, "extendedKeyUsage=clientAuth\n"
        )

    def _sign(self, name: str, subject: str, extension: str) -> tuple[Path, Path]:
        certificate, key = self.folder / f"{name}.crt", self.folder / f"{name}.key"
        request, extensions = self.folder / f"{name}.csr", self.folder / f"{name}.ext"
        extensions.write_text(extension)
        run(["openssl", "req", "-newkey", *CURVE, "-subj", subject, "-keyout", key, "-out", request])
        signer: list[str | Path] = ["-CA", self.certificate, "-CAkey", self._key, "-CAcreateserial"]
        files: list[str | Path] = ["-in", request, "-extfile", extensions, "-out", certificate]
        run(["openssl", "x509", "-req", "-days", DAYS, *signer, *files])
        return certificate, key


def signing_key(folder: Path, name: str) -> tuple[Path, Path]:
    """Private and public RSA key that tokens of service accounts are signed with."""
    folder.mkdir(parents=True, exist_ok=True)
    private, public = folder / f"{name}.key", folder / f"{name}.pub"
    if not public.exists():
        run(["openssl", "genrsa", "-out", private, "2048"])
        run(["openssl", "rsa", "-in", private, "-pubout", "-out", public])
    return private, public


def _escaped(text: str) -> str:
    """A part of a subject as openssl reads it."""
    return "".join(f"\\{sign}" if sign in "/+\\=" else sign for sign in text)
