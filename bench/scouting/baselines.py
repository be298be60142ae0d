"""Figures of the same rivals that were measured before this harness was written, by other code: BASELINES.md.

They are printed beside ours, so that a rival that became weaker is seen. Rows and columns of their transects are those
along which the lines are counted, which is across ours: they fly `transects, rows` along columns.
"""

from __future__ import annotations

from bench.scouting.fields import CORN

_PLACES = (*CORN, "gartner")
_TABLE = {
    "random + tour": "30/51/74 55/74/91 6/22/53 25/47/75 15/35/62 40/62/84 13/34/65 35/59/84",
    "lattice + tour": "30/49/74 66/76/88 5/19/53 25/53/78 14/31/63 44/67/82 11/34/63 36/67/80",
    "transects, columns": "31/48/73 41/61/90 6/19/50 10/26/59 18/33/62 27/46/81 18/40/72 22/46/80",
    "transects, rows": "42/60/81 46/62/83 14/34/74 17/38/75 19/40/68 23/44/70 13/38/62 17/41/64",
    "lawnmower": "45/63/80 46/63/81 44/57/73 44/57/73 47/61/78 47/61/78 47/64/80 47/64/79",
    "GP over its path": "33/51/71 37/60/89 13/27/54 14/30/61 22/36/60 26/43/74 15/36/64 16/40/76",
    "k-NN Classic RL": "45/64/- 58/88/- 41/52/70 45/58/77 50/61/77 60/74/93 36/55/73 49/77/108",
    "3x3 groups, random moves": "32/51/74 47/63/90 6/26/57 27/40/67 15/35/64 37/51/78 11/36/65 30/47/75",
    "oracle + tour": "23/33/43 46/54/67 6/13/22 23/32/42 14/23/32 37/48/56 10/19/29 28/39/50",
}


def published(plan: str, place: str) -> tuple[str, str]:
    """Cells and energy in % for 70, 80 and 90 % accuracy by kriging with 4 agents, such as ("30/51/74", "55/74/91").

    Empty texts where nothing was published.
    """
    if plan not in _TABLE or place not in _PLACES:
        return "", ""
    columns = _TABLE[plan].split()
    at = 2 * _PLACES.index(place)
    return columns[at], columns[at + 1]
