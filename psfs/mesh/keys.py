"""The keys of the viewer."""

from __future__ import annotations

#: The keys, and what they do; 1 to 9 show and hide layers besides.
KEYS = {
    "space": "play, pause",
    "left": "frame before",
    "right": "next frame",
    "home": "first frame",
    "end": "last frame",
    "up": "faster",
    "down": "slower",
    "c": "next colouring",
    "r": "look from the start",
    "q": "close",
}
