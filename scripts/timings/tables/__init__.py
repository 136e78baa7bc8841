"""Results as tables, beside those of the papers."""
