"""What a file that was made says of itself: that it is synthetic, and what it was made with."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Final

STATEMENT: Final = "Synthetic video: the person shown did not say this."


@dataclass(frozen=True)
class Provenance:
    """Where a synthetic video comes from.

    Parameters
    ----------
    source : str
        Name of the database, or of the portrait.
    checksum : str
        Of what it was made from (`database.fingerprint.identity` of a database).
    comment : str, optional
        The maker's own words.
    """

    source: str
    checksum: str
    comment: str | None = None

    def tags(self) -> dict[str, str]:
        """Tags of a media file, under names that all containers know.

        Returns
        -------
        dict of str to str
            ``description`` for people, ``synopsis`` the same as JSON for programs, ``comment``.
        """
        import unitsel  # It imports this module; its version is stated there, once.

        maker = f"unitsel {unitsel.__version__}"
        record = {
            "synthetic": True,
            "made_by": maker,
            "database": self.source,
            "checksum": self.checksum,
        }
        found = {
            "description": f"{STATEMENT} Made by {maker} from {self.source} "
            f"(checksum {self.checksum}).",
            "synopsis": json.dumps(record, ensure_ascii=False),
        }
        if self.comment:
            found["comment"] = self.comment
        return found
