"""Working spaces for colour that Blender offers, by name."""

LUMINANCE = {
    "Linear Rec.709": (0.2126, 0.7152, 0.0722),
    "Linear Rec.2020": (0.2627, 0.6780, 0.0593),
    "ACEScg": (0.2722287, 0.6740818, 0.0536895),
}
"""Of the primaries: ITU-R BT.709 and BT.2020, SMPTE ST 2065-1's AP1."""


def luminance_of(name: str) -> tuple[float, float, float]:
    """Of each primary; Rec.709's where the space is not known."""
    return LUMINANCE.get(name, LUMINANCE["Linear Rec.709"])
