"""The parts of `compare_peers.py`: other programs on the same keypoints, and ours beside them."""
