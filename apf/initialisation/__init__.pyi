from .automatic import find_start as find_start
from .config import StartConfig as StartConfig
from .sequence import initialise as initialise
from .start import Start as Start
from .start import StartError as StartError
