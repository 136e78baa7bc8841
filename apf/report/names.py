"""The names of a report's files."""

PAGE = "report.html"
