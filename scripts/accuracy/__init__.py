"""What `accuracy.py` measures: settings, recorded clouds, runs and their report."""
