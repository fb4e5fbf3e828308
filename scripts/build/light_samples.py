"""Makes the pattern of a light's 256 samples: light.rs and samples.glsl of soft shadows.

A shadow's edge is nearly straight across a light, so a good pattern has its share of samples in every
half-plane. The mean square error of points over all half-planes has a closed form, the energy distance
(Szekely and Rizzo 2013): 2 E|x - Y| - E|x - x'| - E|Y - Y'|, x drawn from the points and Y from the light.
It is made small over a square and over the disk inside it, whose rim is soft, along with the error of
upright boxes, by swapping rows of two columns and annealing. Rows and columns stay distinct. About two
minutes; prints the rows and their errors.
"""

from __future__ import annotations

import math

import numpy as np

COUNT = 256
STEPS = 1_000_000
RIM = 2.5  # light.rs
BOXES = 32
MEAN_WIDTH = {"square": 8.0 / math.pi, "disk": 2.0}
AT = (np.arange(COUNT) + 0.5) / (COUNT / 2) - 1.0


def mean_distances(x: np.ndarray, y: np.ndarray, light: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """From each place (N,) to the points of a light."""
    return np.array([np.hypot(a - light[0], b - light[1]).mean() for a, b in zip(x, y, strict=True)])


def light_points(shape: str, count: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Points that stand for a whole light, each for an equal area."""
    u, v = (
        a.ravel() for a in np.meshgrid((np.arange(count) + 0.5) / count, (np.arange(count) + 0.5) / count)
    )
    if shape == "square":
        return 2.0 * u - 1.0, 2.0 * v - 1.0
    radius, angle = np.sqrt(u), 2.0 * math.pi * (v + 0.5 * u)
    return radius * np.cos(angle), radius * np.sin(angle)


class Pattern:
    """Samples, and sums over them that a swap changes little of."""

    def __init__(self, rows: np.ndarray):
        self.rows = rows
        x, y = np.meshgrid(AT, AT, indexing="ij")
        rim = np.clip(0.5 + RIM * (1.0 - x * x - y * y), 0.0, 1.0)
        self.weights = np.stack([np.ones_like(rim), rim])  # shape, column, row
        lights = [light_points(shape) for shape in MEAN_WIDTH]
        self.within_light = np.array([mean_distances(*light, light).mean() for light in lights])
        to_light = [mean_distances(x.ravel(), y.ravel(), light) for light in lights]
        self.to_light = np.reshape(to_light, (2, COUNT, COUNT))
        self.columns = np.arange(COUNT)
        # Distance by how far columns and rows are apart.
        apart = np.arange(COUNT) / (COUNT / 2)
        self.apart = np.hypot(apart[:, None], apart[None, :])
        edges = np.arange(1, BOXES) / BOXES
        self.in_boxes = -COUNT * np.outer(edges, edges)
        self.light = self.own = self.total = 0.0
        for column in range(COUNT):
            self._count(column, 1.0)
        weights = self.weights[:, self.columns, rows]
        between = self.apart[np.abs(self.columns[:, None] - self.columns), np.abs(rows[:, None] - rows)]
        self.own = np.einsum("si,ij,sj->s", weights, between, weights)

    def _count(self, column: int, sign: float) -> None:
        row = self.rows[column]
        weight = self.weights[:, column, row]
        self.light = self.light + sign * weight * self.to_light[:, column, row]
        self.total = self.total + sign * weight
        self.in_boxes[column * BOXES // COUNT :, row * BOXES // COUNT :] += sign

    def _pairs(self, two: np.ndarray) -> np.ndarray:
        """What two samples add to `own`."""
        rows = self.rows[two]
        distances = self.apart[np.abs(two[:, None] - self.columns), np.abs(rows[:, None] - self.rows)]
        weights = self.weights[:, self.columns, self.rows]
        mine = weights[:, two]
        twice = 2.0 * mine.prod(axis=1) * distances[0, two[1]]
        return 2.0 * (mine * (weights @ distances.T)).sum(axis=1) - twice

    def swap(self, two: np.ndarray) -> None:
        """Exchanges the rows of two columns."""
        self.own = self.own - self._pairs(two)
        for column in two:
            self._count(column, -1.0)
        self.rows[two] = self.rows[two[::-1]]
        for column in two:
            self._count(column, 1.0)
        self.own = self.own + self._pairs(two)

    def squares(self) -> np.ndarray:
        """Mean square errors: half-planes of the square and of the disk, boxes from a corner of it."""
        energy = 2.0 * self.light / self.total - self.own / self.total**2 - self.within_light
        half_planes = energy / (math.pi * np.array(list(MEAN_WIDTH.values())))
        return np.append(half_planes, np.square(self.in_boxes / COUNT).mean())


def anneal(pattern: Pattern, steps: int, seed: int = 3) -> None:
    """Swaps rows, and keeps what betters the mean of the squares; at first also much that does not."""
    random = np.random.default_rng(seed)
    error = pattern.squares().mean()
    for step in range(steps):
        temperature = 0.01 * error * 1e-3 ** (step / steps)
        first = random.integers(COUNT)
        second = random.integers(COUNT) if step % 2 else (first + random.integers(1, 9)) % COUNT
        if first == second:
            continue
        two = np.array([first, second])
        pattern.swap(two)
        found = pattern.squares().mean()
        if found < error or random.random() < math.exp((error - found) / temperature):
            error = found
        else:
            pattern.swap(two)


def main() -> None:
    """Anneals from the bit-reversed sequence."""
    reversed_bits = [int(f"{i:08b}"[::-1], 2) for i in range(COUNT)]
    pattern = Pattern(np.array(reversed_bits))
    for steps in (0, STEPS):
        anneal(pattern, steps)
        square, disk, box = np.sqrt(pattern.squares())
        print(
            f"{steps} steps: half-planes over a square {square:.5f}, over a disk {disk:.5f}; boxes {box:.5f}"
        )
    for first in range(0, COUNT, 16):
        print(", ".join(map(str, pattern.rows[first : first + 16])) + ",")


if __name__ == "__main__":
    main()
