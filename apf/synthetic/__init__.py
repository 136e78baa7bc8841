"""A synthetic person walking in a room, with exact ground truth, for tests and benchmarks."""
