"""Random numbers of the instruments, drawn in advance: the division of a run into frames has no influence on them."""

from __future__ import annotations

from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

_PIECE = 1 << 16


class Stream:
    """Noise and drop-outs of one instrument; they depend only on the seed of the scene and the instrument's name."""

    def __init__(self, seed: int, name: str) -> None:
        words = np.frombuffer(sha256(name.encode()).digest()[:16], dtype=np.uint32)
        noise, gaps = np.random.SeedSequence([seed, *map(int, words)]).spawn(2)
        self._noise = np.random.Generator(np.random.PCG64(noise))
        self._gaps = np.random.Generator(np.random.PCG64(gaps))
        self._last = 0  # start of the last drawn drop-out [ns]
        self.drawn = [0, 0]
        """How many numbers and how many drop-outs have been drawn."""

    def noise(self, numbers: NDArray[np.float64]) -> None:
        """Fill a row with the next standard normal numbers."""
        self.drawn[0] += len(numbers)
        self._noise.standard_normal(out=numbers)

    def gaps(self, n: int, rate: float, shortest: float, longest: float) -> NDArray[np.int64]:
        """The next n drop-outs [n, 2], start and end [ns]: a Poisson process of `rate` [1/s], uniform lengths [s]."""
        self.drawn[1] += n
        u = self._gaps.random((n, 2))
        start = self._last + np.cumsum(np.rint(-1e9 / rate * np.log1p(-u[:, 0])).astype(np.int64))
        self._last = int(start[-1]) if n else self._last
        end = start + np.rint(1e9 * (shortest + (longest - shortest) * u[:, 1])).astype(np.int64)
        return np.column_stack([start, end])

    def skip(self, numbers: int) -> None:
        """Draw and drop the next `numbers` standard normal numbers."""
        for begin in range(0, numbers, _PIECE):
            self.noise(np.empty(min(_PIECE, numbers - begin)))
