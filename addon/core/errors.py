"""What can go wrong, told in one line."""


class StrataError(Exception):
    """Input, scene or output that cannot be used; the message is one line for a person."""


class Cancelled(Exception):
    """The user cancelled; nothing partial is left behind."""


class DeviceUnavailable(Exception):
    """A device does not start here; the message says why."""
