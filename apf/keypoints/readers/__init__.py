"""Readers of keypoint files, one per format; each returns `RawKeypoints`."""
