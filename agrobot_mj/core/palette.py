"""Shared colours: the colour-blind-safe palette of Okabe and Ito (2008), with additional colours.

Figures use the "#RRGGBB" strings. Recordings have a dark background and use the integers from `rgba`.
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
"""Grey for dark backgrounds and grey for white backgrounds, both distinguishable from the other colours."""
BRIGHT_BLUE = "#3A9BDC"
"""Variant of `BLUE` for lines on a dark background."""
ROYAL_BLUE, BROWN = "#3A6FD8", "#8C6D46"
"""Additional colours for plots with many curves on a dark background."""
WINE, OLIVE = "#882255", "#999933"
"""Additional colours for figures with many guidance laws, from Tol's colour-blind-safe muted palette."""
NAMES = {
    **{ORANGE: "orange", SKY_BLUE: "sky blue", VERMILION: "vermilion", GREEN: "green"},
    **{PINK: "pink", YELLOW: "yellow", ROYAL_BLUE: "blue", LIGHT_GREY: "grey"},
}
"""Names of the colours that represent the runs of a comparison."""


def rgba(colour: str, alpha: int = 0xFF) -> int:
    """Return the integer 0xRRGGBBAA of a colour "#RRGGBB"."""
    return int(colour[1:], 16) << 8 | alpha
