"""The subcommands of `apf`, one module each with `register(commands)`."""
