"""Takes: what runs a request to track, for API, commands, batches and studio."""
