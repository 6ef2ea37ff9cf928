"""What the user can mend; nothing is imported here, so that a wrong command is answered at once."""


class UserError(ValueError):
    """Data, a config or an option cannot be used; the message names it, and a command ends with exit code 2."""


class ConfigError(UserError):
    """A config that cannot be run; the message names the key."""
