"""How fast the browsers on the page draw."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import viser

#: Of a picture that a browser is asked for: its height and width, px, and the longest wait for it
#: and the time above which the browser has no graphics chip, s. Software takes 0.7 to 1.8 s.
_SIZE, _PATIENCE, _SLOW = (9, 16), 5.0, 0.4


def draws_slowly(server: viser.ViserServer) -> bool:
    """Ask each browser on the page for a small picture of its scene; return whether one of them
    takes long, as browsers without a graphics chip do. One that is hidden does not count."""
    for client in server.get_clients().values():
        began = time.perf_counter()
        try:
            client.get_render(*_SIZE, timeout=_PATIENCE)
        except (RuntimeError, TimeoutError):  # it was closed, or is hidden
            continue
        if time.perf_counter() - began > _SLOW:
            return True
    return False
