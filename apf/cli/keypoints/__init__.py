"""Keypoints of pose networks: how commands take them, how they are made, triangulation."""
