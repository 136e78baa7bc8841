"""The report of timings: a page, figures, and the README's table."""
