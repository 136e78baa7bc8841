"""Judge a track without ground truth, and report it on a page with player, video and curves."""

#: The names of a report's page and of a track's video, in its folder.
PAGE, OVERLAY = "report.html", "overlay.mp4"
#: Files of a track besides summary and page, as the summary lists them.
FILES = (
    "track.npz", "joints.trc", "joints.csv", "body.toml", "start.txt", "settings.toml", OVERLAY,
)  # fmt: skip
