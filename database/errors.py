"""Every error that this project raises on purpose.

::

    UnitselError
    ├── PhonemeError      a symbol that no phoneme table knows
    ├── TrackError        phoneme times that are not finite, ordered and apart
    ├── TimingError       a timing or words file that cannot be read as its format
    ├── PronunciationError  a word that no dictionary or G2P pronounces
    ├── MediaError        video or sound that cannot be read or written
    ├── ModelError        the face models are missing or altered
    ├── FaceError         no face where one is needed
    ├── AlignmentError    words that do not fit the sound
    ├── SpeechError       text that cannot be spoken, or a synthesizer that fails
    ├── CorpusError       a corpus folder or clip that cannot be used
    ├── DatabaseError     a database that cannot be opened, read or written
    ├── SelectionError    a target or weights that cannot be searched with
    └── RenderError       a picture that cannot be drawn

The message of each is one line for a user: the file, the place in it, and the remedy.
"""


class UnitselError(Exception):
    """Base of all errors of this project."""


class PhonemeError(UnitselError):
    """A symbol that no phoneme table knows."""


class TrackError(UnitselError):
    """Phoneme times that are not finite, ordered and apart."""


class TimingError(UnitselError):
    """A timing or words file that cannot be read as its format."""


class PronunciationError(UnitselError):
    """A word that no dictionary or G2P pronounces."""


class MediaError(UnitselError):
    """Video or sound that cannot be read or written."""


class ModelError(UnitselError):
    """The face models are missing or altered."""


class FaceError(UnitselError):
    """No face where one is needed."""


class AlignmentError(UnitselError):
    """Words that do not fit the sound."""


class SpeechError(UnitselError):
    """Text that cannot be spoken, or a speech synthesizer that fails."""


class CorpusError(UnitselError):
    """A corpus folder or clip that cannot be used."""


class DatabaseError(UnitselError):
    """A database that cannot be opened, read or written."""


class SelectionError(UnitselError):
    """A target or weights that cannot be searched with."""


class RenderError(UnitselError):
    """A picture that cannot be drawn."""
