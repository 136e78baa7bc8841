"""The automatic start: a person's body and first pose from the first voxel clouds alone."""

from apf.start.find import Start, find_start
from apf.start.sequence import start_of

__all__ = ["Start", "find_start", "start_of"]
