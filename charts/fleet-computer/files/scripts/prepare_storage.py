"""Makes the folder of the fleets in HDFS and gives it to their user; a second run changes nothing.

It waits for the NameNode as long as it takes. Environment: NAMENODE (http://host:port), FOLDER, OWNER, SUPERUSER.
"""

from __future__ import annotations

import json
import os
import sys
import time
import urllib.error
import urllib.parse
import urllib.request

PAUSE_S = 2.0
MODE = "750"
DIRECT = urllib.request.build_opener(urllib.request.ProxyHandler({}))
"""No proxy is between two pods, whatever the environment says."""


def say(text: str) -> None:
    """One line for `kubectl logs`, at once."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def call(method: str, operation: str, **arguments: str) -> dict[str, object]:
    """One call of WebHDFS about the folder, as the superuser."""
    words = urllib.parse.urlencode({"op": operation, "user.name": os.environ["SUPERUSER"], **arguments})
    url = f"{os.environ['NAMENODE']}/webhdfs/v1{urllib.parse.quote(os.environ['FOLDER'])}?{words}"
    with DIRECT.open(urllib.request.Request(url, method=method), timeout=10) as answer:
        text = answer.read().decode()
    result: dict[str, object] = json.loads(text) if text else {}
    return result


def reason(error: Exception) -> str:
    """What went wrong, in HDFS's words when it has some."""
    if isinstance(error, urllib.error.HTTPError):
        return f"HTTP {error.code}: {error.read(2000).decode(errors='replace')}"
    return str(error)


def prepare() -> None:
    """Makes the folder; owner and mode are set on one that is there, too."""
    owner = os.environ["OWNER"]
    call("PUT", "MKDIRS", permission=MODE)
    call("PUT", "SETOWNER", owner=owner, group=owner)
    call("PUT", "SETPERMISSION", permission=MODE)
    found = call("GET", "GETFILESTATUS")["FileStatus"]
    say(f"{os.environ['FOLDER']} is there for {owner}: {json.dumps(found, sort_keys=True)}")


def main() -> None:
    """Tries until it is done; each new reason to wait is printed once."""
    said = ""
    while True:
        try:
            return prepare()
        except (OSError, ValueError) as error:  # refused, silent, or in safe mode
            now = reason(error)
        if now != said:
            say(f"waiting for {os.environ['NAMENODE']}: {now}")
            said = now
        time.sleep(PAUSE_S)


if __name__ == "__main__":
    main()
