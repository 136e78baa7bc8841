"""Judge a track without ground truth, and report it on a page with player, video and curves."""

#: The names of a report's page and of a track's video, in its folder.
PAGE, OVERLAY = "report.html", "overlay.mp4"
