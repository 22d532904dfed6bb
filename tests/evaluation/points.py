"""Point clouds, thinned."""
import numpy as np


def thin(points, cell_m):
    """The first point of each cell of a grid, in the order of the cells."""
    if len(points) == 0:
        return points.reshape(0, 3)
    cells = np.floor(points / cell_m).astype(np.int64)
    cells -= cells.min(0)
    size = cells.max(0) + 1
    key = (cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2]
    return points[np.unique(key, return_index=True)[1]]


class Collection:
    """Points gathered from many scans, one for each cell in the end."""

    def __init__(self, cell_m):
        self._cell_m, self._parts, self._loose = cell_m, [], 0

    def add(self, points):
        self._parts.append(thin(points, self._cell_m))
        self._loose += len(self._parts[-1])
        if self._loose > 5_000_000:
            self._parts = [self.points()]
            self._loose = 0

    def points(self):
        return thin(np.concatenate(self._parts), self._cell_m) if self._parts else np.zeros((0, 3))
