"""Results as a page, figures, and the README's table."""
