"""A reader per format of keypoints; each gives `RawKeypoints`."""
