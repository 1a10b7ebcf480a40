"""Why a training does not begin or go on, and why weights are not used."""


class PolicyError(ValueError):
    """Weights that cannot be used; the message says which file and why."""


class TrainingRefusal(ValueError):
    """A training that was asked for wrongly: where, and what would be right."""


class TrainingError(RuntimeError):
    """A training that cannot go on; what was finished is kept, and the message says so."""
