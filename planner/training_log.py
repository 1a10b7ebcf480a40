"""The curves of a training for TensorBoard."""

from __future__ import annotations

import contextlib
import math
from dataclasses import asdict
from pathlib import Path

from planner.learning_errors import TrainingError
from planner.training_events import EpisodeDone


class TensorBoardLog:
    """The episodes' figures as TensorBoard reads them."""

    def __init__(self, folder: Path, first: int):
        """Raises TrainingError where the disk does not take them."""
        from torch.utils.tensorboard import SummaryWriter

        try:
            self._writer = SummaryWriter(str(folder), purge_step=first or None)
        except OSError as error:
            raise TrainingError(f"the curves cannot be written: {error.strerror or error}") from None

    def add(self, done: EpisodeDone) -> None:
        """Raises TrainingError where the disk does not take them."""
        figures = {"return": done.total, "success": float(done.success), "exposed_s": done.exposed_s}
        figures |= {f"terms/{name}": value for name, value in done.terms.items()}
        if done.normalised is not None:
            figures["return_normalised"] = done.normalised
        if done.demonstrated:  # curves of their own, for the policy did not drive
            figures = {f"demonstrations/{name}": value for name, value in figures.items()}
        figures |= {f"losses/{name}": value for name, value in asdict(done.losses).items()}
        figures["steps_per_s"] = done.steps_per_s
        try:
            for name, value in figures.items():
                if math.isfinite(value):
                    self._writer.add_scalar(name, value, done.number)
            self._writer.flush()
        except OSError as error:
            raise TrainingError(f"the curves cannot be written: {error.strerror or error}") from None

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._writer.close()
