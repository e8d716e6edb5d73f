"""The 43 phonemes and 22 visemes of Table 1 (Liu and Ostermann 2009; SAPI 5.1 numbering).

A phoneme's index is its place in `PHONEMES`, everywhere: in tracks, in the database, in the
distance matrix. Other alphabets are mapped into this one by `database.symbols`.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

VISEMES: Final[tuple[tuple[str, ...], ...]] = (
    ("sil",),
    ("ae", "ax", "ah"),
    ("aa",),
    ("ao",),
    ("ey", "eh", "uh"),
    ("er",),
    ("iy", "y", "ih", "ix"),
    ("w", "uw"),
    ("ow",),
    ("aw",),
    ("oy",),
    ("ay",),
    ("h", "hh"),
    ("r",),
    ("l",),
    ("s", "z"),
    ("sh", "ch", "jh", "zh"),
    ("th", "dh"),
    ("f", "v"),
    ("d", "t", "n"),
    ("k", "g", "ng"),
    ("p", "b", "m"),
)
"""Phonemes of each viseme; the place in the tuple is the viseme's number."""

PHONEMES: Final[tuple[str, ...]] = tuple(p for group in VISEMES for p in group)
"""All phonemes, silence first; the place in the tuple is the phoneme's index."""

PHONEME_INDEX: Final[dict[str, int]] = {p: i for i, p in enumerate(PHONEMES)}

N_PHONEMES: Final = len(PHONEMES)
N_VISEMES: Final = len(VISEMES)

SILENCE: Final = PHONEME_INDEX["sil"]

VISEME_OF: Final[npt.NDArray[np.uint8]] = np.array(
    [v for v, group in enumerate(VISEMES) for _ in group], dtype=np.uint8
)
"""(43,) uint8: the viseme of each phoneme index."""
VISEME_OF.setflags(write=False)

CLOSURES: Final[frozenset[int]] = frozenset(PHONEME_INDEX[p] for p in ("p", "b", "m"))
"""Phonemes that close the lips."""
