"""Databases of one person into one: what they were built from, together.

Principal components, the lip model, scales and guides depend on all clips, so a merged database is
fitted anew; the clips' analysis is taken from what the builds have kept, where it was made with the
first one's mask. So the content is that of one build from all clips with the same ``--person``.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from analysis.build import SHARDS_SUFFIX, BuildReport, BuildSettings, ShardSettings, build_database
from analysis.build_work import Progress
from analysis.consent import merged_consent
from analysis.corpus import Clip, clip_name
from analysis.estimate import Estimate
from analysis.kept_person import put_together
from database.errors import DatabaseError
from database.reader import open_database


def merge_databases(
    databases: Sequence[str | Path],
    output: str | Path,
    *,
    jobs: int = 2,
    models: str | Path | None = None,
    dictionary: str | Path | None = None,
    shards: ShardSettings | None = None,
    announce: Callable[[Estimate], None] | None = None,
    progress: Progress | None = None,
) -> BuildReport:
    """Merge databases of one person.

    Parameters
    ----------
    databases : sequence of path
        Two or more, built with the same settings. The first one's mask is that of all. Their
        footage must still be there, unless the builds' kept clips are. Their consent notes stay.
    output : path
        The merged database; may be one of them.
    jobs, models, dictionary, announce, progress
        As in `analysis.build.build_database`.
    shards : ShardSettings, optional
        By default kept clips are looked for beside the databases, and kept beside the output.

    Returns
    -------
    BuildReport

    Raises
    ------
    DatabaseError
        If there are fewer than two, one cannot be read or is of an older unitsel, or they were
        built with different settings.
    UnitselError
        As in `analysis.build.build_database`.
    """
    paths = [Path(p) for p in databases]
    if len(paths) < 2:
        raise DatabaseError("merging takes two databases at least")
    settings, person, clips = _settings_of(paths[0]), _person_of(paths[0]), []
    for path in paths:
        _compare(paths[0], settings, path, _settings_of(path))
        clips += clips_of_database(path)
    settings = replace(settings, consent=merged_consent([(p.name, _consent_of(p)) for p in paths]))
    kept = shards or ShardSettings()
    beside = [p.with_name(p.name + SHARDS_SUFFIX).absolute() for p in paths]
    clips = together(clips)
    looked_at = [c for c in clips_of_database(paths[0]) if c.name in person]
    by_media = {(c.media, c.start): c.name for c in clips}
    return build_database(
        clips,
        output,
        settings=settings,
        jobs=jobs,
        person=[by_media[c.media, c.start] for c in looked_at],
        models=models,
        dictionary=dictionary,
        shards=replace(kept, others=(*kept.others, *(p for p in beside if p.is_dir()))),
        announce=announce,
        progress=progress,
    )


def clips_of_database(path: str | Path) -> list[Clip]:
    """The clips that a database was built from, those that were skipped among them.

    Raises
    ------
    DatabaseError
        If the database cannot be read or does not say.
    """
    footage = _report(Path(path)).get("footage")
    if not footage:
        raise DatabaseError(
            f"{path}: was built by an older unitsel, which did not note where the words are; build "
            "it again from its footage"
        )
    return [Clip.from_json(document) for document in footage]


def together(clips: Sequence[Clip]) -> list[Clip]:
    """Clips of several databases, each once, sorted, with names of their own.

    Where several have one name, their folder tells them apart, as in a corpus that holds both.
    """
    once = {(c.media, c.start, c.end): c for c in clips}
    names = Counter(c.name for c in once.values())
    shared = [c for c in once.values() if names[c.name] > 1]
    if shared:
        root = Path(os.path.commonpath([c.media.parent for c in once.values()]))
        for c in shared:
            stem = c.media.relative_to(root).as_posix()
            given = (None, None) if c.source.whole else (c.start, c.end)
            once[c.media, c.start, c.end] = replace(c, name=clip_name(stem, *given))
    return sorted(once.values(), key=lambda c: c.name)


def _report(path: Path) -> dict[str, Any]:
    with open_database(path) as database:
        return database.report


def _person_of(path: Path) -> set[str]:
    return set(_report(path).get("person", ()))


def _settings_of(path: Path) -> BuildSettings:
    with open_database(path) as database:
        document = database.settings
    try:
        found: BuildSettings = put_together(BuildSettings, document, _no_array)
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise DatabaseError(
            f"{path}: was built by another version of unitsel, whose settings this one does not "
            "know; build it again from its footage"
        ) from error
    return found


def _consent_of(path: Path) -> str:
    with open_database(path) as database:
        return database.consent


def _no_array(name: str) -> Any:
    raise ValueError(f"settings hold no arrays, but {name}")


def _compare(first: Path, wanted: BuildSettings, path: Path, found: BuildSettings) -> None:
    different = [name for name in vars(wanted) if getattr(wanted, name) != getattr(found, name)]
    if different:
        raise DatabaseError(
            f"{path}: was built with other settings than {first} ({', '.join(different)}); build "
            "one of them again with the other's"
        )
