"""Why a training does not begin, or does not go on."""


class TrainingRefusal(ValueError):
    """A training that was asked for wrongly: where, and what would be right."""


class TrainingError(RuntimeError):
    """A training that cannot go on; what was finished is kept, and the message says so."""
