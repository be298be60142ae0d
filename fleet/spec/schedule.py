"""Times at which missions start, as cron writes them: the one module that imports cronsim.

Five fields, in UTC: minute, hour, day of the month, month, day of the week. As with cron, when both days are
restricted, either will do.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from cronsim import CronSim, CronSimError
from pydantic import AfterValidator, Field

SCHEDULE_PATTERN = r"^[0-9A-Za-z*,/-]+( +[0-9A-Za-z*,/-]+){4}$"


def next_start(schedule: str, after_s: float) -> float | None:
    """The first time of a schedule after a time.

    Args:
        schedule: As `spec.missions.schedule`.
        after_s: Seconds since the Unix epoch; so is the answer.
    Returns:
        None when there is no such time any more.
    Raises:
        ValueError: it is no schedule, or one without any time, as on the 30th of February.
    """
    try:
        return next(CronSim(schedule, datetime.fromtimestamp(after_s, UTC))).timestamp()
    except StopIteration:
        return None
    except CronSimError as error:
        hint = "write minute, hour, day of the month, month and day of the week, in UTC: `0 6 * * 1-5`"
        raise ValueError(f'"{schedule}" is not a schedule ({str(error).lower()}); {hint}') from error


def _check_schedule(text: str) -> str:
    next_start(text, 0.0)
    return text


Schedule = Annotated[
    str,
    AfterValidator(_check_schedule),
    Field(max_length=100, json_schema_extra={"pattern": SCHEDULE_PATTERN}),
]
