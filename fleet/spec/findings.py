"""What a rule finds wrong, before it is known where in a file that is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches

from fleet.errors import Problem
from fleet.spec.yaml_text import Document, Path, render


@dataclass(frozen=True)
class Finding:
    """Something wrong, or doubtful, in a document.

    Args:
        path: Where the user should look.
        reads: Values that the finding rests on, when they are not those at `path`. When one of them is broken in
            itself, the finding is not told: it would speak of a value that the user never wrote.
    """

    path: Path
    message: str
    hint: str = ""
    reads: tuple[Path, ...] = ()

    def rests_on(self, broken: Iterable[Path]) -> bool:
        """Whether it rests on one of the broken values."""
        return any(_related(read, other) for other in broken for read in self.reads or (self.path,))

    def problem(self, document: Document) -> Problem:
        """The finding with its place in a document."""
        return Problem(render(self.path), self.message, self.hint, document.line(self.path))


def _related(one: Path, other: Path) -> bool:
    """Whether one of two values is the other, or is inside of it."""
    shorter = min(len(one), len(other))
    return one[:shorter] == other[:shorter]


def nearest(word: str, choices: Iterable[str]) -> str | None:
    """The choice that was probably meant, whatever its case and dashes; None when there is none like it."""
    plain = {_plain(choice): choice for choice in choices}
    close = get_close_matches(_plain(word), plain, n=1, cutoff=0.7)
    return plain[close[0]] if close else None


def did_you_mean(word: str, choices: Iterable[str], otherwise: str = "") -> str:
    """A hint that names the nearest choice, or `otherwise` when none is near."""
    choice = nearest(word, choices)
    return f"did you mean `{choice}`?" if choice else otherwise


def listed(words: Iterable[object], last: str = "or") -> str:
    """Words for a sentence: `a, b or c`."""
    texts = [str(word) for word in words]
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} {last} {texts[-1]}" if texts else ""


def _plain(word: str) -> str:
    return word.lower().replace("_", "").replace("-", "").replace(" ", "")
