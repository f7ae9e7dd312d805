"""Colours that everything drawn shares: the colour-blind-safe palette of Okabe and Ito (2008), and its use by name.

Figures take the "#RRGGBB" strings as they are; recordings, on a dark ground, take `rgba` of them.
"""

BLACK = "#000000"
ORANGE = "#E69F00"
SKY_BLUE = "#56B4E9"
GREEN = "#009E73"
YELLOW = "#F0E442"
BLUE = "#0072B2"
VERMILION = "#D55E00"
PINK = "#CC79A7"
GREY = "#999999"
LIGHT_GREY, DARK_GREY = "#BBBBBB", "#666666"
"""Greys that are told apart from the other colours on a dark and on a white ground."""
BRIGHT_BLUE = "#3A9BDC"
"""`BLUE` for a line on a dark ground, where the original is too dark."""
ROYAL_BLUE, BROWN = "#3A6FD8", "#8C6D46"
"""Further colours for a dark ground, where eight runs or nine rules are drawn."""
WINE, OLIVE = "#882255", "#999933"
"""Two more for figures of many laws, from Tol's muted palette, colour-blind safe as well."""
NAMES = {
    **{ORANGE: "orange", SKY_BLUE: "sky blue", VERMILION: "vermilion", GREEN: "green"},
    **{PINK: "pink", YELLOW: "yellow", ROYAL_BLUE: "blue", LIGHT_GREY: "grey"},
}
"""Names of the colours that a comparison gives to its runs."""


def rgba(colour: str, alpha: int = 0xFF) -> int:
    """0xRRGGBBAA of the colour "#RRGGBB"."""
    return int(colour[1:], 16) << 8 | alpha
