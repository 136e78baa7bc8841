"""The parts of `accuracy.py`: settings, recorded clouds, runs and their report."""
