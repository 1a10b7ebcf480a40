"""The physics of one scene for many drives, one after another: its ground is built once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from scenes.physics import World, WorldState
from scenes.scenario import CoverObject, MovingObstacle, Start
from scenes.terrain import Heightmap


class Stage:
    """Called in `World`'s place, it gives what `World` gives, and what follows is the same to the last bit.

    While the arguments stay the same it is the same world, put back to its first moment: one drive at a time.
    Closing it does nothing; it ends with the stage.
    """

    def __init__(self) -> None:
        self._set_for: tuple[Any, ...] = ()
        self._world: _Kept | None = None
        self._first: WorldState | None = None

    def __call__(
        self,
        heightmap: Heightmap,
        cover: Sequence[CoverObject] = (),
        obstacles: Sequence[MovingObstacle] = (),
        start: Start | None = None,
        *,
        time_s: float = 0.0,
    ) -> World:
        """Raises ValueError as `World` does."""
        wanted = id(heightmap), tuple(cover), tuple(obstacles), start, time_s
        world, first = self._world, self._first
        if world is not None and first is not None and wanted == self._set_for and world.sound:
            with suppress(ValueError):  # its cover or obstacles are others by now
                world.restore(first)
                return world
        self._world = world = _Kept(heightmap, cover, obstacles, start, time_s=time_s)
        self._first, self._set_for = world.save(), wanted
        return world


class _Kept(World):
    """Frees its client when nobody knows it any more."""

    def close(self) -> None:
        pass

    @property
    def sound(self) -> bool:
        """Whether nothing has blown up."""
        return all(map(math.isfinite, (*self.pose.position, self.up)))
