"""The subcommands of `psfs`, one module each; `register(commands)` adds it to the parser."""
