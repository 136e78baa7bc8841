"""Entry point of `python -m apf.cli`."""

import sys

from apf.cli import main

sys.exit(main())
