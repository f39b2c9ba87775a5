#!/usr/bin/env python3
"""Second computation of the tests between groups, by SciPy and scikit-bio, on the fixed data of the unit tests.

    python3 -m venv venv && venv/bin/pip install numpy scipy scikit-bio scikit-learn
    venv/bin/python scripts/check_statistics.py

prints the constants that stand in src/statistics/amplitude/compare.rs, src/statistics/compare/omnibus.rs and
src/statistics/recognize/lda.rs.
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


# Two groups: Welch's interval, Hedges' g, two one-sided tests, all splits.
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

# The same people twice.
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

# Location and scatter of three groups from their distances.
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
own = np.array([np.linalg.norm(POINTS[i] - POINTS[labels == labels[i]].mean(axis=0)) for i in range(15)])
scatter = stats.f_oneway(*(own[labels == g] for g in range(3)))
random = np.random.default_rng(1)
f = lambda order: stats.f_oneway(*(own[order == g] for g in range(3))).statistic
larger = sum(f(random.permutation(labels)) >= scatter.statistic - 1e-10 for _ in range(9999))
show("SCIKIT_BIO", [location_f, scatter.statistic, location_p, (1 + larger) / 10000])

# Shrinkage of a covariance (Ledoit and Wolf), and discriminants with it.
from sklearn.covariance import ledoit_wolf

X = np.array([[math.sin(1.7 * i + 0.9 * j) + (i % 2) * (j == 1) * 1.5 for j in range(5)] for i in range(12)])
y = np.arange(12) % 2
means = np.array([X[y == c].mean(axis=0) for c in (0, 1)])
covariance, shrinkage = ledoit_wolf(X - means[y], assume_centered=True)
inverse = np.linalg.inv(covariance)
new = np.array([0.3, -0.2, 0.5, 0.1, -0.4])
squares = [(new - m) @ inverse @ (new - m) for m in means]
show("SCIKIT_LEARN", [shrinkage, *squares])
