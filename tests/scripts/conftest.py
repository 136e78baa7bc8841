"""Scripts are imported as they import one another."""

import sys

from helpers.shared import ROOT

sys.path.insert(0, str(ROOT / "scripts"))
