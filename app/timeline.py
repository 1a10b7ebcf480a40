"""How exposed a drive was, tick by tick, for the plot in the panel."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from app.store import FRAME_COLUMNS

_COLUMNS = [FRAME_COLUMNS.index(name) for name in ("time_s", "exposure", "detection_probability")]


class Timeline:
    """Time, visible fraction and probability of detection since the mission began."""

    def __init__(self) -> None:
        self._ticks: list[tuple[float, ...]] = []

    def __len__(self) -> int:
        return len(self._ticks)

    def clear(self) -> None:
        self._ticks.clear()

    def extend(self, rows: Iterable[tuple[float, ...]]) -> None:
        """Rows in the order of `app.store.FRAME_COLUMNS`; after a step back in time, as from a restored
        mission, what had been later goes."""
        for row in rows:
            tick = tuple(row[column] for column in _COLUMNS)
            while self._ticks and tick[0] <= self._ticks[-1][0]:
                self._ticks.pop()
            self._ticks.append(tick)

    def curves(self, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, fractions and probabilities, each (n,) with n at most about `most`: of several ticks in one,
        the largest fraction, so that no glimpse is lost."""
        table = np.array(self._ticks, float).reshape(-1, len(_COLUMNS))
        if len(table) > most:
            starts = np.arange(0, len(table), -(-len(table) // most))
            table = np.maximum.reduceat(table, starts, axis=0)
        return table[:, 0], table[:, 1], table[:, 2]
