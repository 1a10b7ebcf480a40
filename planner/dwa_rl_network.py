"""DWA-RL's policy: a small network that looks at every row of the window with the same eyes.

The published one (Patel et al. 2021) is a convolution over the 144 × 10 picture of the rows; this one reads
each row by one perceptron and weighs it against the mean and the maximum of all, so that what is learnt of
one velocity holds for the others. Beside it, the same mean and maximum set gains on what is read of a row. It
begins as the published dynamic window: the less the total cost, the likelier the row.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from planner.checkpoint import PolicyName, load_weights, read_tensors, weights, write_tensors
from planner.dwa_rl_window import CHANNELS, WINDOW
from planner.learning_errors import PolicyError

BARRED = -1e9
"""Logit of a row that is not admissible."""


@dataclass(frozen=True)
class RowsArchitecture:
    """rows, sets : of the tensor that is read; hidden : width; eagerness : logits by which the first row is
    ahead of the last before anything is learnt; swiftness : by which the gains are learnt faster than the
    rest."""

    rows: int = WINDOW.rows
    sets: int = WINDOW.sets
    hidden: int = 48
    eagerness: float = 15.0
    swiftness: float = 5.0
    name: str = "dwa_rl_rows"


class WindowPolicy(nn.Module):
    """Tensors (n, rows, sets, 4) and admissible (n, rows) bool to logits (n, rows) and values (n,)."""

    def __init__(self, architecture: RowsArchitecture | None = None):
        super().__init__()
        self.architecture = shape = architecture or RowsArchitecture()
        # v, w and the to-goal cost are the same in all sets; the rank and whether it may be chosen beside.
        read = shape.sets + 7
        self.row = nn.Sequential(
            nn.Linear(read, shape.hidden), nn.ReLU(), nn.Linear(shape.hidden, 32), nn.ReLU()
        )
        self.gains = nn.Linear(64, read)
        self.own, self.others, self.score = nn.Linear(32, 32), nn.Linear(64, 32), nn.Linear(32, 1)
        self.critic, self.value = nn.Linear(64, 64), nn.Linear(64, 1)
        for last in (self.score, self.value, self.gains):
            nn.init.zeros_(last.weight)
            nn.init.zeros_(last.bias)

    def forward(self, tensor: Tensor, admissible: Tensor) -> tuple[Tensor, Tensor]:
        shape = self.architecture
        newest, obstacle = tensor[:, :, -1], tensor[:, :, :, CHANNELS.index("obstacle")]
        # A window is narrow: what tells its rows apart is where in it they are.
        v, w, goal = (_standard(newest[:, :, CHANNELS.index(name)]) for name in ("v", "w", "goal"))
        rank = torch.linspace(0.0, 1.0, shape.rows).expand(len(tensor), -1)
        read = torch.cat(
            [
                newest[:, :, :2],
                torch.stack([v, w, goal], 2),
                0.5 * torch.log(obstacle + 1e-2) + 1.0,
                rank[..., None],
                admissible[..., None].float(),
            ],
            2,
        )
        rows = self.row(read)
        whole = torch.cat([rows.mean(1), rows.amax(1)], 1)
        beside = torch.relu(self.own(rows) + self.others(whole)[:, None])
        logits = self.score(beside).squeeze(2) - shape.eagerness * rank
        logits = logits + shape.swiftness * (read * self.gains(whole)[:, None]).sum(2)
        value = self.value(torch.relu(self.critic(whole))).squeeze(1)
        return torch.where(admissible, logits, torch.full_like(logits, BARRED)), value


def _standard(values: Tensor) -> Tensor:
    """Of mean 0 and deviation 1 over the rows (n, rows)."""
    return (values - values.mean(1, keepdim=True)) / values.std(1, keepdim=True).clamp_min(1e-4)


def save_window_policy(path: Path, policy: WindowPolicy) -> PolicyName:
    """Write it with its architecture. Raises OSError."""
    about = {"architecture": json.dumps(asdict(policy.architecture))}
    return PolicyName(path.stem, write_tensors(path, weights(policy), about))


def load_window_policy(path: Path) -> tuple[WindowPolicy, PolicyName]:
    """The policy in a file, ready to drive. Raises PolicyError where it is none of these."""
    tensors, metadata, sha256 = read_tensors(path)
    try:
        architecture = RowsArchitecture(**json.loads(metadata["architecture"]))
    except (KeyError, TypeError, ValueError):
        raise PolicyError(f"{path} holds no weights of the architecture 'dwa_rl_rows'") from None
    policy = WindowPolicy(architecture)
    load_weights(policy, tensors, path)
    return policy.eval(), PolicyName(path.stem, sha256)
