#!/usr/bin/env python3
"""Recomputes with NumPy the results of `grimace run DATASET -o RESULTS --covariate COLUMN` and compares them with its files.

    scripts/check_covariates.py RESULTS MANIFEST COLUMN [EMOTION]

Computes F and share by projections on the squared distances (McArdle & Anderson 2001), and the shares of all nodes and both models by least
squares from RESULTS/models. Prints the largest differences to the files. Valid only when every person has one sequence and one number, and all
people are in the test.
"""

import csv
import pathlib
import sys

import numpy as np

results, manifest, column = pathlib.Path(sys.argv[1]), sys.argv[2], sys.argv[3]
emotion = sys.argv[4] if len(sys.argv) > 4 else "happiness"


def table(path):
    return list(csv.DictReader(open(path, newline="")))


def model(path):
    places = {(int(row["frame"]), int(row["node"])): (float(row["x"]), float(row["y"])) for row in table(path)}
    return np.array([[places[frame, node] for node in nodes] for frame in range(1 + max(frame for frame, _ in places))])


said = next(r for r in table(results / "covariates.csv") if r["emotion"] == emotion and r["covariate"] == column)
said_nodes = [r for r in table(results / "covariate_nodes.csv") if r["emotion"] == emotion and r["covariate"] == column]
nodes = [int(r["node"]) for r in said_nodes]
models, numbers = [], []
for row in table(manifest):
    path = results / "models" / f"{row['subject']}_{row['sequence']}.csv"
    if row["emotion"] == emotion and row[column] not in ("", "NA") and path.exists():
        models.append(model(path))
        numbers.append(float(row[column]))
models, numbers = np.array(models), np.array(numbers)
count = len(numbers)

steps = models[:, 1:] - models[:, :-1]
d = np.array([np.linalg.norm(steps - own, axis=-1).mean((1, 2)) for own in steps])
centring = np.eye(count) - 1 / count
gower = centring @ (-0.5 * d * d) @ centring
design = np.c_[np.ones(count), numbers]
hat = design @ np.linalg.inv(design.T @ design) @ design.T
rest = np.eye(count) - hat
explained, left = np.trace(hat @ gower @ hat), np.trace(rest @ gower @ rest)
offsets = models[:, 1:] - models[:, :1]
centred, away = offsets - offsets.mean(0), numbers - numbers.mean()
slope = np.tensordot(away, centred, (0, 0)) / (away**2).sum()
on_line = away[:, None, None, None] * slope
shares = (on_line**2).sum((0, 1, 3)) / (centred**2).sum((0, 1, 3))
print(f"{count} people, {said['subjects']} in the table")
print(f"F {explained / (left / (count - 2)):.9g}, in the table {said['f']}; share {explained / np.trace(gower):.9g}, {said['share']}")
print(f"largest difference of a node's share {np.abs(shares - [float(r['share']) for r in said_nodes]).max():.1e}")
for end in ("low", "high"):
    shown = model(results / f"{said['models']}_{end}.csv")
    expected = offsets.mean(0) + slope * (float(said[end]) - numbers.mean())
    print(f"largest difference of the model for {said[end]}: {np.abs(shown[1:] - shown[:1] - expected).max():.1e} face units")
