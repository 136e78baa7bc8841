from .automatic import find_start as find_start
from .config import StartConfig as StartConfig
from .sequence import start_of as start_of
from .start import Start as Start
from .start import StartError as StartError
