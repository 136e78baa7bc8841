"""The one error that commands turn into a clear line and exit code 2."""


class UserError(Exception):
    """Something the user can mend: a file, a flag, a device.

    The message is one line that names what was found and what was expected.
    """
