"""Representative facial expressions from image sequences.

Axes and units, everywhere:

- Image space: pixels, x right, y down; the centre of the top-left pixel is (0, 0).
- Face space: x to the subject's left, y up. Left and right are always the subject's own.
- Face unit: the canonical neutral Candide-3 with ES0 = 1024; one face unit is one FAP unit of ES.

A picture is the path of a file, or an array of ``uint8``: rows x columns (grey) or rows x columns x 3 (RGB). Objects that
``numpy.asarray`` converts to such an array, such as PIL images, are accepted, too. Arrays of models are float64, frames x nodes x 2;
Candide-3 has 113 nodes.

Calls release the interpreter's lock, and Ctrl-C ends calls that take long. All errors are a :class:`GrimaceError`.
"""

from ._grimace import (
    CloneError,
    FapError,
    FitError,
    GrimaceError,
    InputError,
    LocateError,
    NormalizeError,
    RunError,
    StatisticsError,
    SynthesisError,
    TrackError,
    __version__,
)
from .faces import Face, Fit, Marks, Picture, fit, locate, read_marks
from .fap import Fap, Finding
from .making import Clone, Motion, Synthesis, clone, synthesize
from .pipeline import Failure, Results, RunSummary, run
from .statistics import Comparison, Models, Representative, compare, representative
from .tracks import Track, normalize, read_model, track, write_model
from .wireframe import Candide3, candide3

__all__ = [
    "Candide3",
    "Clone",
    "CloneError",
    "Comparison",
    "Face",
    "Failure",
    "Fap",
    "FapError",
    "Finding",
    "Fit",
    "FitError",
    "GrimaceError",
    "InputError",
    "LocateError",
    "Marks",
    "Models",
    "Motion",
    "NormalizeError",
    "Picture",
    "Representative",
    "Results",
    "RunError",
    "RunSummary",
    "StatisticsError",
    "Synthesis",
    "SynthesisError",
    "Track",
    "TrackError",
    "__version__",
    "candide3",
    "clone",
    "compare",
    "fit",
    "locate",
    "normalize",
    "read_marks",
    "read_model",
    "representative",
    "run",
    "synthesize",
    "track",
    "write_model",
]
