"""What the inside of a portrait's mouth looks like: a photo with closed lips does not show it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]


@dataclass(frozen=True)
class MouthLook:
    """Colours of the generic mouth, in the photo's light.

    Parameters
    ----------
    teeth, gum, tongue, cavity : (3,) float32
        RGB levels, 0 to 255, where they are lit best; the cavity's is that of its depth.
    """

    teeth: F32
    gum: F32
    tongue: F32
    cavity: F32

    def as_array(self) -> F32:
        """The four colours, (4, 3) float32."""
        return np.stack([self.teeth, self.gum, self.tongue, self.cavity]).astype(np.float32)

    @classmethod
    def from_array(cls, colours: npt.NDArray[np.floating]) -> MouthLook:
        """From `as_array`'s."""
        teeth, gum, tongue, cavity = np.asarray(colours, dtype=np.float32)
        return cls(teeth, gum, tongue, cavity)
