"""`python -m psfs.cli`."""

import sys

from psfs.cli import main

sys.exit(main())
