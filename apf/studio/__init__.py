"""The page in the browser: see, run, watch, correct and take home. Needs the extra `studio`."""
