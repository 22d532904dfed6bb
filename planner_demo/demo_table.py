#!/usr/bin/env python3
"""Compares the server's answers of a demo run with the exact distances: demo_table.py FOLDER

The folder holds answers_AHEAD.csv and truth_AHEAD.csv for the same points at several horizons.
"""
import csv
import pathlib
import sys

import numpy as np

CLAMP_M = 4.9  # answers end at 5 m


def read(path):
    with open(path, newline="") as f:
        return list(csv.DictReader(f))


def column(rows, name, kind=float):
    return np.array([kind(row[name]) for row in rows])


def main():
    folder = pathlib.Path(sys.argv[1])
    print("Distances at points called free, 0.5 m above the ground, against the exact ones")
    header = ("ahead s", "points", "median error m", "p95 m", "an object decides", "the right one")
    print("  ".join(header))
    for path in sorted(folder.glob("answers_*.csv"), key=lambda p: float(p.stem.split("_")[1])):
        ahead = path.stem.split("_")[1]
        answers, truth = read(path), read(folder / f"truth_{ahead}.csv")
        exact = column(truth, "distance_m")
        use = (column(answers, "state", str) == "free") & (exact > 0) & (exact < CLAMP_M)
        error = np.abs(column(answers, "distance_m") - exact)[use]
        said, owner = column(answers, "object_id", int)[use], column(truth, "object_id", int)[use]
        moving = owner > 0
        right = f"{(said == owner)[moving].mean():.0%}" if moving.any() else "-"
        cells = (f"{float(ahead):.1f}", str(use.sum()),
                 f"{np.median(error):.3f}" if use.any() else "-",
                 f"{np.percentile(error, 95):.3f}" if use.any() else "-", str(moving.sum()), right)
        print("  ".join(c.rjust(len(h)) for c, h in zip(cells, header)))


if __name__ == "__main__":
    main()
