"""The folder of kept clips beside a database: what a killed build, and the next one, go on from.

    DB.h5.shards/
        lock                    held by the build that is at work, or names the last one
        person-*.shard          the mask and camera, and the clips that they were made of
        <circumstances>/        one folder for each set of circumstances (analysis/identity.py)
            circumstances.json
            <clip>.shard        or <clip>.refused, where the clip cannot be used

Whatever does not match any more is simply not found. Deleting the folder does no harm: the next
build analyses all clips.
"""

from __future__ import annotations

import contextlib
import json
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, overload

import numpy.typing as npt

from analysis.build_lock import clear_partials
from analysis.build_settings import BuildSettings
from analysis.corpus import Clip
from analysis.face import FaceFinder
from analysis.identity import (
    clip_identity,
    digest_of,
    models_digest,
    settings_digest,
    software_digest,
)
from analysis.kept_person import put_together, taken_apart
from analysis.models import FaceModels
from analysis.person import Person, study_person
from analysis.shards import (
    SHARD,
    Refusal,
    Shard,
    ShardDamagedError,
    load_shard,
    read_checked,
    write_arrays,
)
from database.errors import DatabaseError
from database.outfile import whole_file
from database.piece import Source

CIRCUMSTANCES: Final = "circumstances.json"
_OURS: Final = re.compile(r"[0-9a-f]{32}")
_PERSON: Final = re.compile(r"person-[0-9a-f]{32}\.shard")


class ShardStore:
    """Kept clips of one database, or of several that share a folder.

    Parameters
    ----------
    folder : Path
        Made if it is not there.
    fresh : bool
        Find nothing in it.
    others : sequence of Path
        Folders of other builds; what is not here is looked for there, and copied.

    Raises
    ------
    DatabaseError
        If it cannot be made.
    """

    def __init__(self, folder: Path, *, fresh: bool = False, others: Sequence[Path] = ()) -> None:
        self.folder = folder
        self._others = tuple(others)
        self._fresh = fresh
        self.lock = folder / "lock"
        self.damaged: list[str] = []
        """Clips whose shard was damaged."""
        self._here = folder
        self._parts: dict[str, str] = {}
        self._person: Path | None = None
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DatabaseError(
                f"{folder}: cannot be made ({error.strerror}); name another folder with --shards"
            ) from error

    def enter(self, parts: Mapping[str, str]) -> None:
        """Go to the shards of these circumstances (`analysis.identity.circumstances`)."""
        self._parts = dict(parts)
        self._here = self.folder / digest_of(*sorted(parts.items()))
        self._here.mkdir(exist_ok=True)
        clear_partials(self._here, ".*.partial")
        (self._here / CIRCUMSTANCES).write_text(json.dumps(self._parts), encoding="utf-8")

    def path(self, clip: Clip, sha256: str) -> Path:
        """Place of a clip's shard.

        Raises
        ------
        OSError
            If one of its scripts cannot be read.
        """
        return self._here / f"{clip_identity(self._here.name, clip, sha256)}{SHARD}"

    def find(self, clip: Clip, path: Path) -> Shard | Refusal | None:
        """What is kept of a clip; a damaged shard is noted and taken for none."""
        try:
            if self._fresh:
                return None
            return load_shard(path, clip) or self._taken_over(clip, path)
        except ShardDamagedError:
            self.damaged.append(clip.name)
            return None

    def _taken_over(self, clip: Clip, path: Path) -> Shard | Refusal | None:
        """A clip's shard from another build's folder, if one has it."""
        for folder in self._others:
            there = folder / self._here.name / path.name
            if there.is_file() and isinstance(load_shard(there, clip), Shard):
                _copy(there, path)
                return load_shard(path, clip)
        return None

    def person(
        self,
        clips: Sequence[Clip],
        sums: Mapping[Path, str],
        finder: FaceFinder,
        models: FaceModels,
        settings: BuildSettings,
    ) -> tuple[Person, tuple[str, ...]]:
        """The person as `analysis.person.study_person` finds them in clips, found or kept.

        What is kept is taken if the clips that were looked at are still the first.

        Parameters
        ----------
        clips : sequence of Clip
            In the order in which they are looked at.
        sums : mapping of Path to str
            SHA-256 of their media.
        finder : FaceFinder
        models : FaceModels
        settings : BuildSettings

        Returns
        -------
        person : Person
        names : tuple of str
            The clips that were looked at.

        Raises
        ------
        FaceError
            If no clip shows a face.
        """
        key = digest_of(software_digest(), models_digest(models), settings_digest(settings))
        self._person = self.folder / f"person-{key}{SHARD}"
        clear_partials(self.folder, ".person-*.partial")
        order = [digest_of(sums[c.media], c.start, c.end) for c in clips]
        for other in self._others if not self._person.is_file() else ():
            if (other / self._person.name).is_file():
                _copy(other / self._person.name, self._person)
                break
        kept = None
        with contextlib.suppress(ShardDamagedError):
            kept = None if self._fresh else read_checked(self._person)
        if kept is not None:
            about = kept.about
            looked = about["looked"]
            # Had it come to the last clip, it might have gone on to another.
            if order[: len(looked)] == looked and (order == looked or not about["all"]):
                names = tuple(c.name for c in clips[: len(looked)])
                return put_together(Person, about["person"], kept.__getitem__), names
        videos = _Watched([c.source for c in clips])
        person = study_person(
            videos,
            finder,
            focal=settings.focal,
            crop=settings.crop,
            camera=settings.camera,
            estimate_focal=settings.estimate_focal,
            settings=settings.motion,
            hand=settings.hand,
        )
        arrays: dict[str, npt.NDArray[Any]] = {}
        document = {
            "looked": order[: videos.looked],
            "all": videos.looked == len(clips),
            "person": taken_apart(person, arrays),
        }
        write_arrays(self._person, document, **arrays)
        return person, tuple(c.name for c in clips[: videos.looked])

    def changed(self) -> tuple[str, ...]:
        """What differs from the circumstances of the clips that were kept last; () if none were."""
        others = [f for f in self._folders() if f != self._here and any(f.glob(f"*{SHARD}"))]
        for folder in sorted(others, key=lambda f: f.stat().st_mtime, reverse=True):
            with contextlib.suppress(OSError, ValueError):
                before = json.loads((folder / CIRCUMSTANCES).read_text(encoding="utf-8"))
                return tuple(k for k, v in self._parts.items() if before.get(k) != v)
        return ()

    def size(self) -> int:
        """Bytes of all that is kept."""
        return sum(p.stat().st_size for p in self.folder.rglob("*") if p.is_file())

    def forget_others(self) -> None:
        """Delete what was kept under other circumstances."""
        for folder in self._folders():
            if folder != self._here:
                shutil.rmtree(folder, ignore_errors=True)
        for path in self._persons():
            if path != self._person:
                path.unlink(missing_ok=True)

    def forget_all(self) -> None:
        """Delete all that is kept, and the folder if nothing foreign is in it."""
        for folder in self._folders():
            shutil.rmtree(folder, ignore_errors=True)
        self.tidy()

    def tidy(self) -> None:
        """Delete what interrupted workers left half-written, and folders that keep no clip."""
        clear_partials(self._here, ".*.partial")
        for folder in self._folders():
            if not any(folder.glob(f"*{SHARD}")):
                shutil.rmtree(folder, ignore_errors=True)
        if not self._folders():
            for path in self._persons():
                path.unlink(missing_ok=True)
            self.lock.unlink(missing_ok=True)
            with contextlib.suppress(OSError):
                self.folder.rmdir()

    def _folders(self) -> list[Path]:
        return [p for p in self.folder.iterdir() if p.is_dir() and _OURS.fullmatch(p.name)]

    def _persons(self) -> list[Path]:
        return [p for p in self.folder.iterdir() if _PERSON.fullmatch(p.name)]


def _copy(source: Path, target: Path) -> None:
    """Copy a file, whole or not at all."""
    with source.open("rb") as data, whole_file(target) as file:
        shutil.copyfileobj(data, file)


class _Watched(Sequence[Source]):
    """Paths that remember how many of them were looked at."""

    def __init__(self, paths: Sequence[Source]) -> None:
        self._paths = paths
        self.looked = 0

    @overload
    def __getitem__(self, place: int) -> Source: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[Source]: ...
    def __getitem__(self, place: int | slice) -> Source | Sequence[Source]:
        chosen = range(len(self._paths))[place]
        last = chosen if isinstance(chosen, int) else max(chosen, default=-1)
        self.looked = max(self.looked, last + 1)
        return self._paths[place]

    def __len__(self) -> int:
        return len(self._paths)
