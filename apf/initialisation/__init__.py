"""The automatic start: a person's body and first pose from the first voxel clouds alone."""

from apf.initialisation.automatic import Start, find_start
from apf.initialisation.sequence import start_of

__all__ = ["Start", "find_start", "start_of"]
