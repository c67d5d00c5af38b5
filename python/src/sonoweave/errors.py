"""Exceptions of the package."""

from __future__ import annotations

__all__ = ["CalibrationError", "FrameRefused", "InputError", "MemoryLimit", "SonoweaveError"]


class SonoweaveError(Exception):
    """Base of the package's exceptions."""


class FrameRefused(SonoweaveError):
    """A frame was refused; the volume has not changed.

    Parameters
    ----------
    sentence : str
        The reason in words.
    reason : str
        The reason's name, as in the ledger.
    item : int
        Number of the frame among those inserted, from 0.

    Attributes
    ----------
    reason : str
        The reason's name, as in the ledger.
    item : int
        Number of the frame among those inserted, from 0.
    """

    def __init__(self, sentence: str, reason: str = "", item: int = -1) -> None:
        super().__init__(sentence, reason, item)
        self.reason = reason
        self.item = item

    def __str__(self) -> str:
        """Return the sentence."""
        return str(self.args[0])


class InputError(SonoweaveError, ValueError):
    """An argument, a setting or the content of a file does not fit."""


class MemoryLimit(SonoweaveError, MemoryError):
    """The memory limit is reached, or the system has no memory."""


class CalibrationError(SonoweaveError):
    """No transforms lead from the image to the world.

    Parameters
    ----------
    sentence : str
        The problem in words.
    missing : tuple of str
        Names of the frames of reference that no transforms connect: from, to.

    Attributes
    ----------
    missing : tuple of str
        Names of the frames of reference that no transforms connect: from, to.
    """

    def __init__(self, sentence: str, missing: tuple[str, str] = ("", "")) -> None:
        super().__init__(sentence, missing)
        self.missing = missing

    def __str__(self) -> str:
        """Return the sentence."""
        return str(self.args[0])
