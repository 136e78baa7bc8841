"""Judge a track without ground truth, and report it on a page with player, video and curves."""
