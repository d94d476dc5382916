"""Colours of figures. Colour-blind readers can distinguish them.

Source: M. Okabe, K. Ito, Color Universal Design, 2008.
"""

BLUE, VERMILION, GREEN, PURPLE, AMBER, SKY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"
LINES = (BLUE, VERMILION, GREEN, PURPLE, AMBER, SKY)
"""Colours of curves, in the order in which they are used."""
GREY = "#666666"
"""Guide lines, and what belongs to no curve."""
ALARM = "#9b2226"
"""Critical values, limits, faults."""
