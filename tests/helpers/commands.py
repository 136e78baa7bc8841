"""What the words of a command line state."""

from apf.cli.commands import COMMANDS
from apf.request import TrackRequest
from psfs.cli.program import find_stated, program_parser
from psfs.common.requests import Stated


def state_track(*words: str) -> Stated:
    """What the words behind `apf track` state."""
    args = program_parser("apf", "", COMMANDS).parse_args(["track", *words])
    return find_stated(TrackRequest, args)
