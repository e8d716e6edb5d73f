"""What an analysed clip depends on: if all of it is the same, so is the clip's shard.

That is the clip itself (its name, its media and what tells its words) and the circumstances of
the build, which all clips share: mask, camera, frame rate, settings, models, dictionary, code and
libraries. Where the files lie makes no difference.
"""

from __future__ import annotations

import hashlib
import json
import platform
from contextlib import suppress
from dataclasses import asdict, astuple, replace
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import numpy.typing as npt

from analysis.build_settings import BuildSettings
from analysis.clip import sha256_of
from analysis.corpus import Clip
from analysis.kept_person import taken_apart
from analysis.models import FaceModels
from analysis.person import Person
from database.mask import Camera
from database.writer import library_versions

FITTED_LATER: Final = ("texture", "lag", "guide", "offset", "lips", "consent")
"""Parts of the build's settings that no clip is analysed with: they may change and clips stay."""

RUN_LATER: Final = frozenset(
    (
        *("aam.py", "aam_fit.py", "aam_kernels.py", "aam_points.py", "aam_training.py"),
        *("assemble.py", "build.py", "build_lock.py", "build_work.py", "cost_model.py"),
        *("corpus_lips.py", "merge.py"),
        *("estimate.py", "guide.py", "interrupts.py", "lag.py", "phone_marks.py"),
        *("phoneme_distance.py", "shard_store.py", "sound_offset.py", "footage.py", "manifest.py"),
        *("utterance.py", "consent.py", "background_tracking.py", "shut_eyes.py"),
    )
)
"""Modules of this folder whose code no clip goes through."""

_NOWHERE: Final = Camera(1.0, 0.0, 0.0, 1, 1)
_OTHER_LIBRARIES: Final = ("numba", "espeakng-loader", "ai-edge-litert")


def circumstances(
    person: Person,
    fps: float,
    models: FaceModels,
    dictionary: str | Path | None,
    settings: BuildSettings,
) -> dict[str, str]:
    """Digests of what all clips of a build share, by what a user calls it.

    Parameters
    ----------
    person : Person
    fps : float
        Of the database.
    models : FaceModels
    dictionary : path, optional
        The user's pronunciations.
    settings : BuildSettings
    """
    arrays: dict[str, npt.NDArray[Any]] = {}
    document = json.dumps(taken_apart(replace(person, camera=_NOWHERE), arrays))
    return {
        "mask": digest_of(document, *(part for a in arrays.items() for part in _parts(*a))),
        "camera": digest_of(*map(float, astuple(person.camera))),
        "frame rate": digest_of(float(fps)),
        "settings": settings_digest(settings),
        "face models": models_digest(models),
        "dictionary": "" if dictionary is None else sha256_of(Path(dictionary)),
        "version of unitsel or of a library": software_digest(),
    }


def _parts(name: str, array: npt.NDArray[Any]) -> tuple[object, ...]:
    return name, array.dtype.str, array.shape, array.tobytes()


def clip_identity(common: str, clip: Clip, sha256: str) -> str:
    """What tells a clip's shard from all others.

    Parameters
    ----------
    common : str
        Digest of the circumstances.
    clip : Clip
    sha256 : str
        Of its media.

    Returns
    -------
    str
        32 hexadecimal digits.

    Raises
    ------
    OSError
        If a script cannot be read.
    """
    scripts = [part for path in clip.scripts for part in (path.name, path.read_bytes())]
    return digest_of(common, clip.name, sha256, clip.start, clip.end, clip.words, *scripts)


def digest_of(*parts: object) -> str:
    """SHA-256 of parts, each with its length; 32 hexadecimal digits."""
    digest = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, bytes) else repr(part).encode()
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()[:32]


def settings_digest(settings: BuildSettings) -> str:
    """Digest of the settings that clips are analysed with."""
    given = {k: v for k, v in asdict(settings).items() if k not in FITTED_LATER}
    return digest_of(json.dumps(given, sort_keys=True))


def models_digest(models: FaceModels) -> str:
    """Digest of the face models."""
    return digest_of(models.detector.read_bytes(), models.mesh.read_bytes())


@cache
def software_digest() -> str:
    """Digest of the code that a clip goes through, of the libraries' versions and the machine.

    Of the code itself and not of a number that somebody has to remember to raise: no build may
    mix clips of two analyses.
    """
    versions = library_versions()
    for name in _OTHER_LIBRARIES:
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    here = Path(__file__).parent
    files = [p for p in here.glob("*.py") if p.name not in RUN_LATER]
    files += (here.parent / "database").rglob("*.py")
    code = [(p.relative_to(here.parent).as_posix(), p.read_bytes()) for p in sorted(files)]
    parts = [part for name, text in code for part in (name, text)]
    return digest_of(json.dumps(versions, sort_keys=True), platform.machine(), *parts)
