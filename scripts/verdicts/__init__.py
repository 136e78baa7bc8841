"""How often the verdict of a track is right, see `judge_verdicts.py`."""
