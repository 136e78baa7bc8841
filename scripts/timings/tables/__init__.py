"""Tables of the results, beside those of the papers."""
