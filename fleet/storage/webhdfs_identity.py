"""Who we are for WebHDFS: a delegation token where there is one, else the user's name."""

from __future__ import annotations

import os
from pathlib import Path

from fleet.errors import StorageUnavailable
from fleet.storage.webhdfs_address import WebHdfsAddress

TOKEN = "FLEET_STORAGE_TOKEN"
TOKEN_FILE = "FLEET_STORAGE_TOKEN_FILE"


def identity(address: WebHdfsAddress) -> dict[str, str]:
    """Parameters that every call to a NameNode carries; a token's file is read anew, as others renew it.

    Raises:
        StorageUnavailable: the token's file cannot be read.
    """
    token, file = os.environ.get(TOKEN, ""), os.environ.get(TOKEN_FILE, "")
    if not token and file:
        try:
            token = Path(file).read_text().strip()
        except (OSError, ValueError) as error:
            raise StorageUnavailable(f"{TOKEN_FILE} is {file}, which cannot be read: {error}") from error
    return {"delegation": token} if token else {"user.name": address.user}
