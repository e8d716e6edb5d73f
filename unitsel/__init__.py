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

import importlib
import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

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

if TYPE_CHECKING:
    from analysis.align import AlignSettings, Attempt
    from analysis.alignment import Alignment
    from analysis.build import BuildReport, BuildSettings, build_database
    from analysis.face import FaceSettings
    from analysis.guide import GuideSettings
    from analysis.lag import LagSettings
    from analysis.merge import merge_databases
    from analysis.motion import CropSettings, MotionSettings
    from analysis.portrait import PortraitReport, PortraitSettings, make_portrait
    from analysis.portrait_adjust import Adjustment, Drag, adjust, read_adjustment
    from analysis.texture import TextureSettings
    from database.cost_definition import CostSettings, FeatureWeights
    from database.errors import (
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
    from database.heads import open_head
    from database.lexicon import Lexicon, spread_words
    from database.phonemes import PHONEMES, VISEMES
    from database.planes import Colour, Planes, planes_to_rgb
    from database.portrait_file import PortraitHead
    from database.portrait_mesh import FaceMotion
    from database.reader import UnitDatabase, open_database
    from database.sound import Sound, read_sound
    from database.timing import (
        Timing,
        read_timing,
        timing_extensions,
        write_timing,
    )
    from database.timing.words import WordTrack
    from database.track import Interval, PhonemeTrack
    from render.background import Background
    from render.blend import BlendShape
    from unitsel.background_keeping import add_backgrounds, remove_backgrounds
    from unitsel.background_ranking import RankedBackground, rank_backgrounds
    from unitsel.costs import Weights
    from unitsel.doctor.page import write_doctor_page
    from unitsel.doctor.report import DoctorReport, doctor_report
    from unitsel.explain import write_explanation
    from unitsel.heads import synthesizer_of
    from unitsel.inspection import Inspection, inspect_database
    from unitsel.likeness.evaluation import Evaluation, evaluate
    from unitsel.likeness.folds import evaluate_folds
    from unitsel.lip_targets import RestSettings
    from unitsel.placed import Placed
    from unitsel.portrait.driver import DriveSettings
    from unitsel.portrait.facts import PortraitFacts, inspect_portrait
    from unitsel.portrait.performance import Performance
    from unitsel.portrait.synthesizer import PortraitSynthesizer
    from unitsel.provenance import Provenance
    from unitsel.select import Fallback, Selection
    from unitsel.settings import (
        SelectionSettings,
        TargetSettings,
        default_settings,
    )
    from unitsel.speech.spoken import Speech, speak
    from unitsel.speech_track import align_media, track_of_timing
    from unitsel.streaming import StreamedFrame
    from unitsel.synthesizer import Synthesizer
    from unitsel.training.pareto import ParetoSettings
    from unitsel.training.result import Training, TrainingSettings
    from unitsel.training.train import train
    from unitsel.writing import Encoding, Written

__version__ = "0.1.0"

__all__ = [
    "PHONEMES",
    "VISEMES",
    "Adjustment",
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
    "Drag",
    "DriveSettings",
    "Encoding",
    "Evaluation",
    "FaceError",
    "FaceMotion",
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
    "Performance",
    "PhonemeError",
    "PhonemeTrack",
    "Placed",
    "Planes",
    "PortraitFacts",
    "PortraitHead",
    "PortraitReport",
    "PortraitSettings",
    "PortraitSynthesizer",
    "PronunciationError",
    "Provenance",
    "RankedBackground",
    "RenderError",
    "RestSettings",
    "Selection",
    "SelectionError",
    "SelectionSettings",
    "Sound",
    "Speech",
    "SpeechError",
    "StreamedFrame",
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
    "adjust",
    "align_media",
    "build_database",
    "default_settings",
    "doctor_report",
    "evaluate",
    "evaluate_folds",
    "inspect_database",
    "inspect_portrait",
    "make_portrait",
    "merge_databases",
    "open_database",
    "open_head",
    "planes_to_rgb",
    "rank_backgrounds",
    "read_adjustment",
    "read_sound",
    "read_timing",
    "remove_backgrounds",
    "speak",
    "spread_words",
    "synthesizer_of",
    "timing_extensions",
    "track_of_timing",
    "train",
    "write_doctor_page",
    "write_explanation",
    "write_timing",
]

_HOMES: Final = {
    "analysis.align": "AlignSettings Attempt",
    "analysis.alignment": "Alignment",
    "analysis.build": "BuildReport BuildSettings build_database",
    "analysis.face": "FaceSettings",
    "analysis.guide": "GuideSettings",
    "analysis.lag": "LagSettings",
    "analysis.merge": "merge_databases",
    "analysis.motion": "CropSettings MotionSettings",
    "analysis.portrait": "PortraitReport PortraitSettings make_portrait",
    "analysis.portrait_adjust": "Adjustment Drag adjust read_adjustment",
    "analysis.texture": "TextureSettings",
    "database.cost_definition": "CostSettings FeatureWeights",
    "database.errors": "AlignmentError CorpusError DatabaseError FaceError MediaError ModelError "
    "PhonemeError PronunciationError RenderError SelectionError SpeechError TimingError "
    "TrackError UnitselError",
    "database.heads": "open_head",
    "database.lexicon": "Lexicon spread_words",
    "database.phonemes": "PHONEMES VISEMES",
    "database.planes": "Colour Planes planes_to_rgb",
    "database.portrait_file": "PortraitHead",
    "database.portrait_mesh": "FaceMotion",
    "database.reader": "UnitDatabase open_database",
    "database.sound": "Sound read_sound",
    "database.timing": "Timing read_timing timing_extensions write_timing",
    "database.timing.words": "WordTrack",
    "database.track": "Interval PhonemeTrack",
    "render.background": "Background",
    "render.blend": "BlendShape",
    "unitsel.background_keeping": "add_backgrounds remove_backgrounds",
    "unitsel.background_ranking": "RankedBackground rank_backgrounds",
    "unitsel.costs": "Weights",
    "unitsel.doctor.page": "write_doctor_page",
    "unitsel.doctor.report": "DoctorReport doctor_report",
    "unitsel.explain": "write_explanation",
    "unitsel.heads": "synthesizer_of",
    "unitsel.inspection": "Inspection inspect_database",
    "unitsel.likeness.evaluation": "Evaluation evaluate",
    "unitsel.likeness.folds": "evaluate_folds",
    "unitsel.lip_targets": "RestSettings",
    "unitsel.placed": "Placed",
    "unitsel.portrait.driver": "DriveSettings",
    "unitsel.portrait.facts": "PortraitFacts inspect_portrait",
    "unitsel.portrait.performance": "Performance",
    "unitsel.portrait.synthesizer": "PortraitSynthesizer",
    "unitsel.provenance": "Provenance",
    "unitsel.select": "Fallback Selection",
    "unitsel.settings": "SelectionSettings TargetSettings default_settings",
    "unitsel.speech.spoken": "Speech speak",
    "unitsel.speech_track": "align_media track_of_timing",
    "unitsel.streaming": "StreamedFrame",
    "unitsel.synthesizer": "Synthesizer",
    "unitsel.training.pareto": "ParetoSettings",
    "unitsel.training.result": "Training TrainingSettings",
    "unitsel.training.train": "train",
    "unitsel.writing": "Encoding Written",
}
"""Where each public name is made; read when it is first asked for, as the libraries below take
seconds to load, and neither a command nor a process of a build needs them all."""

_MODULE_OF: Final = {name: home for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """Load a public name (PEP 562)."""
    home = _MODULE_OF.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(importlib.import_module(home), name)
    return value


def __dir__() -> list[str]:
    """List the public names, loaded or not."""
    return sorted({*globals(), *__all__})
