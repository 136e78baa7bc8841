"""Motion file formats by file ending: `WRITERS` need points only, `BODY_WRITERS` need the body."""
