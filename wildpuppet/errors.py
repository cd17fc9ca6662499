"""Errors that a user can cause and mend. Each message says what was expected, what was found and what to do."""


class WildPuppetError(Exception):
    """A user's mistake or a limit of the machine; the command line prints it on one line and exits with 2."""


class InputError(WildPuppetError):
    """A file, a box, a range or another input that cannot be used as it is."""


class PuppetError(WildPuppetError):
    """A puppet folder that cannot be read or built."""


class SettingsError(WildPuppetError):
    """A setting with an unknown name or a value out of its range."""


class StoreError(WildPuppetError):
    """The store cannot be read or written: a full disk, no permission, or a newer version's files."""
