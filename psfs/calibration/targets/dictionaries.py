"""The families of ArUco markers that boards may have."""

from __future__ import annotations

#: By the names that --dictionary takes, OpenCV's names of their sets, smallest first. A set is the
#: beginning of those after it; the fewer markers to tell apart, the more and the sooner are found.
DICTIONARIES = {
    **{
        family: [f"DICT_{family}_{count}" for count in (50, 100, 250, 1000)]
        for family in ("4X4", "5X5", "6X6", "7X7")
    },
    "ARUCO_ORIGINAL": ["DICT_ARUCO_ORIGINAL"],
    "APRILTAG_36h11": ["DICT_APRILTAG_36h11"],
}
