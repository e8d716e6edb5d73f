"""A person's own rulers: what of a database sentences are measured by."""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.lips import mesh_mouth_height
from database.phonemes import SILENCE
from database.reader import UnitDatabase
from database.track import context_frames
from unitsel.likeness.eye_measures import closure_threshold, lip_opening, natural_step
from unitsel.likeness.references import phoneme_means
from unitsel.likeness.scores import Trajectories

FloatArray = npt.NDArray[np.float64]

REST_SECONDS: Final = 0.12
"""A frame with silence as far as this on both sides shows the lips at rest."""

LANDMARK_ROWS: Final = 4096
"""Units whose meshes are in memory at a time."""


class Rulers:
    """Measures of all units, each taken when it is first asked for.

    Parameters
    ----------
    database : UnitDatabase
    """

    def __init__(self, database: UnitDatabase) -> None:
        self.database = database

    @cached_property
    def mesh(self) -> tuple[FloatArray, FloatArray]:
        """Mouth height and lip opening of each unit's raw mesh, both (N,)."""
        rows = range(0, len(self.database), LANDMARK_ROWS)
        meshes = (self.database.landmarks(slice(r, r + LANDMARK_ROWS)) for r in rows)
        parts = [(mesh_mouth_height(m), lip_opening(m)) for m in meshes]
        height, opening = (np.concatenate(p) for p in zip(*parts, strict=True))
        return height, opening

    @cached_property
    def closed_at(self) -> float:
        """Lip opening up to which the person's lips are closed."""
        opening, phoneme = self.mesh[1], self.database.units.phoneme
        around = self.database.context(context_frames(self.database.fps, REST_SECONDS))
        speaking = phoneme != SILENCE
        rest = opening[(around == SILENCE).all(axis=1)]
        return closure_threshold(rest, opening[speaking] if speaking.any() else opening)

    @cached_property
    def natural_step(self) -> float:
        """A great natural step from frame to frame (`eye_measures.natural_step`)."""
        units = self.database.units
        return natural_step(units.pca, units.sequence, units.frame)

    @cached_property
    def phoneme_means(self) -> FloatArray:
        """Mean of each phoneme: first PCA weight, mouth height, mesh height, opening, (43, 4)."""
        units = self.database.units
        values = np.column_stack([units.pca[:, 0], units.mouth_height, *self.mesh])
        return phoneme_means(values, units.phoneme)

    def trajectories(self, units: npt.NDArray[np.integer]) -> Trajectories:
        """The mouth over some units."""
        parameters = self.database.units
        height, opening = self.mesh
        return Trajectories(
            parameters.pca[units, 0].astype(np.float64),
            parameters.mouth_height[units].astype(np.float64),
            height[units],
            opening[units],
        )
