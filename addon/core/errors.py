"""What can go wrong, told in one line."""


class StrataError(Exception):
    """Input, scene or output that cannot be used; the message is one line for a person."""


class Cancelled(Exception):  # noqa: N818 - not an error: somebody asked for it
    """The user cancelled; nothing partial is left behind."""


class DeviceUnavailable(Exception):  # noqa: N818
    """A device does not start here; the message says why."""
