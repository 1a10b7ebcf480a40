"""How lists read in sentences."""

from __future__ import annotations


def listed(words: list[str]) -> str:
    """Some words in a row, at least one; of more than three, how many more there are."""
    if len(words) > 3:
        words = [*words[:2], f"{len(words) - 2} more"]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
