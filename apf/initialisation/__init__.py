"""The automatic start: a person's body and first pose from the first voxel clouds alone."""

from apf.initialisation.automatic import find_start
from apf.initialisation.config import StartConfig
from apf.initialisation.sequence import initialise
from apf.initialisation.start import Start, StartError

__all__ = ["Start", "StartConfig", "StartError", "find_start", "initialise"]
