"""Colours as colour-blind readers see them, and how far two of them are apart.

Source: Machado, Oliveira, Fernandes, IEEE Trans. Vis. Comput. Graph. 15 (2009), matrices of severity 1.0 over linear
RGB; distances in CIELAB (CIE 1976), in which 2 to 3 is just noticeable.
"""

from itertools import combinations

import numpy as np
from matplotlib.colors import to_rgb

NORMAL = np.eye(3)
KINDS = {
    "normal": NORMAL,
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
_WHITE = np.array([0.95047, 1.0, 1.08883])


def lab(colour, kind="normal"):
    """The colour in CIELAB for a reader with this vision."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(KINDS[kind]) @ linear, 0.0, 1.0)
    t = _XYZ @ seen / _WHITE
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def nearest(colours):
    """The smallest distance of two of the colours over all kinds of vision: distance, kind, the two."""
    return min(
        (float(np.linalg.norm(lab(a, kind) - lab(b, kind))), kind, a, b)
        for kind in KINDS
        for a, b in combinations(colours, 2)
    )
