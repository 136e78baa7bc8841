"""A synthetic person walking in a room, with exact truth: test data and benchmark scene."""
