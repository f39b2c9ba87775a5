#!/usr/bin/env python3
"""Recomputes the tests between groups with SciPy, scikit-bio and scikit-learn, on the fixed data of the unit tests.

    python3 -m venv venv && venv/bin/pip install numpy scipy scikit-bio scikit-learn
    venv/bin/python scripts/check_statistics.py

Prints the constants in src/statistics/amplitude/compare.rs, src/statistics/compare/omnibus.rs and src/statistics/recognize/lda.rs.
"""

import itertools
import math

import numpy as np
from scipy import stats

A = np.array([1.31, 0.92, 1.54, 1.20, 0.81, 1.66, 1.43, 1.02])
B = np.array([0.71, 0.95, 0.62, 1.10, 0.84, 0.55, 0.99])
MARGIN, POWER = 0.2, 0.8


def show(name, values):
    print(name, "=", ", ".join(f"{value:.9g}" for value in values))


# Two groups: Welch's interval, Hedges' g, two one-sided tests, and all splits.
welch = stats.ttest_ind(A, B, equal_var=False)
interval = welch.confidence_interval(0.95)
na, nb = len(A), len(B)
pooled = math.sqrt(((na - 1) * A.var(ddof=1) + (nb - 1) * B.var(ddof=1)) / (na + nb - 2))
g = (1 - 3 / (4 * (na + nb - 2) - 1)) * (A.mean() - B.mean()) / pooled
tost = max(
    stats.ttest_ind(A + MARGIN, B, equal_var=False, alternative="greater").pvalue,
    stats.ttest_ind(A - MARGIN, B, equal_var=False, alternative="less").pvalue,
)
both = np.concatenate([A, B])
splits = [both[list(split)].sum() for split in itertools.combinations(range(na + nb), na)]
differences = np.array([s / na - (both.sum() - s) / nb for s in splits])
exact = np.mean(np.abs(differences) >= abs(A.mean() - B.mean()) - 1e-12)
show("SCIPY_INDEPENDENT", [A.mean() - B.mean(), interval.low, interval.high, g, tost, exact])
z = stats.norm.ppf(0.975) + stats.norm.ppf(POWER)
print("SCIPY_PEOPLE =", math.ceil(2 * (z / g) ** 2 + stats.norm.ppf(0.975) ** 2 / 4))

# The same people measured twice.
P = A[:7]
paired = stats.ttest_rel(P, B)
interval = paired.confidence_interval(0.95)
tost = max(
    stats.ttest_rel(P + MARGIN, B, alternative="greater").pvalue,
    stats.ttest_rel(P - MARGIN, B, alternative="less").pvalue,
)
signs = np.array(list(itertools.product([-1, 1], repeat=len(P))))
exact = np.mean(np.abs((signs * (P - B)).mean(axis=1)) >= abs((P - B).mean()) - 1e-12)
show("SCIPY_PAIRED", [(P - B).mean(), interval.low, interval.high, tost, exact])

# Location and scatter of three groups, from their distances.
POINTS = np.array(
    [(0.1, 0.4), (1.2, -0.3), (-0.7, 0.8), (0.5, -1.1), (-0.2, 0.3)]
    + [(2.1, 1.9), (3.0, 0.2), (1.1, 3.3), (4.2, 2.8), (2.5, -0.9)]
    + [(0.3, 2.2), (0.9, 2.6), (0.6, 1.8), (1.0, 2.1), (0.4, 2.5)]
)
labels = np.repeat([0, 1, 2], 5)
distances = np.linalg.norm(POINTS[:, None] - POINTS[None], axis=2)
try:
    from skbio.stats.distance import DistanceMatrix, permanova

    np.random.seed(1)
    location = permanova(DistanceMatrix(distances), labels.astype(str), permutations=99999)
    location_f, location_p = location["test statistic"], location["p-value"]
except ImportError:
    location_f = location_p = math.nan


def scatter_f(points, order):
    """F statistic of the distances of people to the centroid of their group in `order`."""
    groups = [points[order == g] for g in np.unique(order)]
    return stats.f_oneway(*(np.linalg.norm(group - group.mean(axis=0), axis=1) for group in groups)).statistic


def pseudo_f(points, order):
    squares = lambda group: ((group - group.mean(axis=0)) ** 2).sum()
    groups = [points[order == g] for g in np.unique(order)]
    within = sum(squares(group) for group in groups)
    return ((squares(points) - within) / (len(groups) - 1)) / (within / (len(points) - len(groups)))


random = np.random.default_rng(1)
scatter = scatter_f(POINTS, labels)
larger = sum(scatter_f(POINTS, random.permutation(labels)) >= scatter - 1e-10 for _ in range(9999))
show("SCIKIT_BIO", [location_f, scatter, location_p, (1 + larger) / 10000])

# The first two groups, by all ways to divide their people.
ten, halves = POINTS[:10], labels[:10]
orders = [np.isin(np.arange(10), split).astype(int) for split in itertools.combinations(range(10), 5)]
exact = [np.mean([f(ten, o) >= f(ten, halves) * (1 - 1e-10) for o in orders]) for f in (pseudo_f, scatter_f)]
show("NUMPY_EXACT", exact)

# Shrinkage of a covariance (Ledoit and Wolf), and discriminants that use it.
from sklearn.covariance import ledoit_wolf

X = np.array([[math.sin(1.7 * i + 0.9 * j) + (i % 2) * (j == 1) * 1.5 for j in range(5)] for i in range(12)])
y = np.arange(12) % 2
means = np.array([X[y == c].mean(axis=0) for c in (0, 1)])
covariance, shrinkage = ledoit_wolf(X - means[y], assume_centered=True)
inverse = np.linalg.inv(covariance)
new = np.array([0.3, -0.2, 0.5, 0.1, -0.4])
squares = [(new - m) @ inverse @ (new - m) for m in means]
show("SCIKIT_LEARN", [shrinkage, *squares])
