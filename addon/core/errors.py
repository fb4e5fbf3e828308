"""What can go wrong, told in one line."""


class StrataError(Exception):
    """Input, scene or output that cannot be used; the message is one line for a person."""


class Cancelled(Exception):
    """The user cancelled; nothing partial is left behind."""


class DeviceUnavailable(Exception):
    """A device does not start here; the message says why."""


class ShaderError(Exception):
    """A GPU program does not compile here. `log` is what the compiler said."""

    def __init__(self, name: str, log: str):
        first = next((line.strip(" |") for line in log.splitlines() if "rror:" in line), log[:200])
        super().__init__(f"shader '{name}' does not compile: {first}")
        self.log = log
