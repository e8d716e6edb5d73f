"""Image-based talking heads by unit selection (Liu and Ostermann 2009).

``import unitsel`` is all a user needs::

    report = unitsel.build_database("corpus", "me.h5")
    with unitsel.open_database("me.h5") as database:
        synthesizer = unitsel.Synthesizer(database)
        track = unitsel.read_timing("hello.TextGrid").phones
        selection = synthesizer.select(track)
        synthesizer.write(selection, "hello.mp4", audio="hello.wav")
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

# Our other three packages have common names. Say so before a stranger's module of the same
# name fails in some less helpful way.
for _name in ("database", "analysis", "render"):
    _spec = importlib.util.find_spec(_name)
    _expected = Path(__file__).resolve().parent.parent / _name / "__init__.py"
    if _spec is None or _spec.origin is None or Path(_spec.origin).resolve() != _expected:
        _found = (
            None
            if _spec is None
            else (_spec.origin or next(iter(_spec.submodule_search_locations or ()), None))
        )
        raise ImportError(
            f"{_found} hides unitsel's own package {_name!r} ({_expected}); rename it, or run from "
            "another folder"
            if _found
            else f"unitsel's own package {_name!r} is missing ({_expected}); install unitsel again"
        )

from analysis.align import AlignSettings, Attempt  # noqa: E402
from analysis.alignment import Alignment  # noqa: E402
from analysis.build import BuildReport, BuildSettings, build_database  # noqa: E402
from analysis.face import FaceSettings  # noqa: E402
from analysis.guide import GuideSettings  # noqa: E402
from analysis.lag import LagSettings  # noqa: E402
from analysis.merge import merge_databases  # noqa: E402
from analysis.motion import CropSettings, MotionSettings  # noqa: E402
from analysis.texture import TextureSettings  # noqa: E402
from database.cost_definition import CostSettings, FeatureWeights  # noqa: E402
from database.errors import (  # noqa: E402
    AlignmentError,
    CorpusError,
    DatabaseError,
    FaceError,
    MediaError,
    ModelError,
    PhonemeError,
    PronunciationError,
    RenderError,
    SelectionError,
    SpeechError,
    TimingError,
    TrackError,
    UnitselError,
)
from database.lexicon import Lexicon, spread_words  # noqa: E402
from database.phonemes import PHONEMES, VISEMES  # noqa: E402
from database.planes import Colour, Planes, planes_to_rgb  # noqa: E402
from database.reader import UnitDatabase, open_database  # noqa: E402
from database.sound import Sound, read_sound  # noqa: E402
from database.timing import (  # noqa: E402
    Timing,
    read_timing,
    timing_extensions,
    write_timing,
)
from database.timing.words import WordTrack  # noqa: E402
from database.track import Interval, PhonemeTrack  # noqa: E402
from render.background import Background  # noqa: E402
from render.blend import BlendShape  # noqa: E402
from unitsel.background_keeping import add_backgrounds, remove_backgrounds  # noqa: E402
from unitsel.background_ranking import RankedBackground, rank_backgrounds  # noqa: E402
from unitsel.costs import Weights  # noqa: E402
from unitsel.doctor.page import write_doctor_page  # noqa: E402
from unitsel.doctor.report import DoctorReport, doctor_report  # noqa: E402
from unitsel.explain import write_explanation  # noqa: E402
from unitsel.inspection import Inspection, inspect_database  # noqa: E402
from unitsel.likeness.evaluation import Evaluation, evaluate  # noqa: E402
from unitsel.likeness.folds import evaluate_folds  # noqa: E402
from unitsel.select import Fallback, Selection  # noqa: E402
from unitsel.settings import (  # noqa: E402
    SelectionSettings,
    TargetSettings,
    default_settings,
)
from unitsel.speech.spoken import Speech, speak  # noqa: E402
from unitsel.speech_track import align_media, track_of_timing  # noqa: E402
from unitsel.synthesizer import Synthesizer  # noqa: E402
from unitsel.training.pareto import ParetoSettings  # noqa: E402
from unitsel.training.result import Training, TrainingSettings  # noqa: E402
from unitsel.training.train import train  # noqa: E402
from unitsel.writing import Written  # noqa: E402

__version__ = "0.1.0"

__all__ = [
    "PHONEMES",
    "VISEMES",
    "AlignSettings",
    "Alignment",
    "AlignmentError",
    "Attempt",
    "Background",
    "BlendShape",
    "BuildReport",
    "BuildSettings",
    "Colour",
    "CorpusError",
    "CostSettings",
    "CropSettings",
    "DatabaseError",
    "DoctorReport",
    "Evaluation",
    "FaceError",
    "FaceSettings",
    "Fallback",
    "FeatureWeights",
    "GuideSettings",
    "Inspection",
    "Interval",
    "LagSettings",
    "Lexicon",
    "MediaError",
    "ModelError",
    "MotionSettings",
    "ParetoSettings",
    "PhonemeError",
    "PhonemeTrack",
    "Planes",
    "PronunciationError",
    "RankedBackground",
    "RenderError",
    "Selection",
    "SelectionError",
    "SelectionSettings",
    "Sound",
    "Speech",
    "SpeechError",
    "Synthesizer",
    "TargetSettings",
    "TextureSettings",
    "Timing",
    "TimingError",
    "TrackError",
    "Training",
    "TrainingSettings",
    "UnitDatabase",
    "UnitselError",
    "Weights",
    "WordTrack",
    "Written",
    "__version__",
    "add_backgrounds",
    "align_media",
    "build_database",
    "default_settings",
    "doctor_report",
    "evaluate",
    "evaluate_folds",
    "inspect_database",
    "merge_databases",
    "open_database",
    "planes_to_rgb",
    "rank_backgrounds",
    "read_sound",
    "read_timing",
    "remove_backgrounds",
    "speak",
    "spread_words",
    "timing_extensions",
    "track_of_timing",
    "train",
    "write_doctor_page",
    "write_explanation",
    "write_timing",
]
