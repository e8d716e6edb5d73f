"""Which face is meant where a picture shows several, and that it stays the same one.

The choice is made once a video, when the wanted face is first seen. When it is lost, other
people are remembered where they were, so that the search does not go over to one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from analysis.detector import FaceBox
from database.errors import FaceError

CHOICES: Final = ("main", "left", "right", "largest")
"""Names of choices; besides them a number, counted from the left from 1."""

OFF_CENTRE: Final = 0.5
"""What a face at the picture's corner loses of its size when the main one is chosen."""


def check_choice(choice: str) -> str:
    """A choice of face that can be made.

    Raises
    ------
    FaceError
        If it is none.
    """
    if choice in CHOICES or (choice.isascii() and choice.isdigit() and int(choice) >= 1):
        return choice
    raise FaceError(
        f"{choice!r} chooses no face; choose {', '.join(CHOICES)}, or a number counted from the "
        "left, from 1"
    )


def choose(faces: Sequence[FaceBox], choice: str, width: int, height: int) -> int | None:
    """Which of the faces is meant.

    Parameters
    ----------
    faces : sequence of FaceBox
    choice : str
        ``main``: the largest and most central; ``largest``, ``left``, ``right``; or a number
        from the left.
    width, height : int
        Of the picture.

    Returns
    -------
    int or None
        None where there are not so many faces.
    """
    if not faces:
        return None
    across = np.argsort([f.x for f in faces], kind="stable")
    if choice == "left":
        return int(across[0])
    if choice == "right":
        return int(across[-1])
    if choice.isdigit():
        number = int(choice)
        return int(across[number - 1]) if number <= len(faces) else None
    if choice == "largest":
        return int(np.argmax([f.size for f in faces]))
    corner = float(np.hypot(width, height)) / 2
    weight = [
        f.size * f.score * (1 - OFF_CENTRE * np.hypot(f.x - width / 2, f.y - height / 2) / corner)
        for f in faces
    ]
    return int(np.argmax(weight))


class Company:
    """The wanted face and the others of a video, where each was seen last.

    Parameters
    ----------
    choice : str
        See `choose`.
    """

    def __init__(self, choice: str) -> None:
        self.choice = check_choice(choice)
        self.wanted: FaceBox | None = None
        self._others: list[FaceBox] = []

    @property
    def counts(self) -> bool:
        """Whether the choice is among all who are there, not of the one who stands out."""
        return self.choice not in ("main", "largest")

    def pick(self, faces: Sequence[FaceBox], width: int, height: int) -> FaceBox | None:
        """The wanted one of the faces of a picture, or None."""
        if self.wanted is None:
            place = choose(faces, self.choice, width, height)
        else:
            place = self._again(faces)
        return None if place is None else faces[place]

    def settle(self, wanted: FaceBox, faces: Sequence[FaceBox]) -> None:
        """Tell that the picked one is a face indeed, and whose company it is in."""
        self.wanted = wanted
        self.look_round(faces)

    def look_round(self, faces: Sequence[FaceBox]) -> None:
        """Remember where everybody else is."""
        if self.wanted is not None:
            # Who is not seen just now is still about.
            gone = [o for o in self._others if all(f.distance(o.x, o.y) > 1 for f in faces)]
            around = [*faces, *gone]
            self._others = [f for f in around if f.distance(self.wanted.x, self.wanted.y) > 1]

    def follow(self, x: float, y: float) -> None:
        """Tell where the wanted face is now."""
        if self.wanted is not None:
            w = self.wanted
            self.wanted = FaceBox(x, y, w.size, w.angle, w.score)

    def _again(self, faces: Sequence[FaceBox]) -> int | None:
        """The face that was lost, told from the others by where each was."""
        wanted = self.wanted
        assert wanted is not None
        near: list[tuple[float, int]] = []
        for i, face in enumerate(faces):
            own = face.distance(wanted.x, wanted.y)
            if all(own <= face.distance(o.x, o.y) for o in self._others):
                near.append((own, i))
        return min(near)[1] if near else None
