"""2-D keypoints of any pose network: files, points on the body, triangulation."""
