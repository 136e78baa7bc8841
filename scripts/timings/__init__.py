"""The measurements of `compare_timings.py`, one module per subcommand."""
