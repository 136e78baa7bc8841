"""What `compare_timings.py` measures, one module per subcommand."""
