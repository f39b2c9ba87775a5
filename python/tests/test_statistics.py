import numpy as np
import pytest

import grimace


def test_the_representative_is_the_median_and_the_outlier_is_trimmed(models):
    found = grimace.representative([models(s) for s in (0.6, 0.8, 1.0, 1.1, 5.0)], alpha=0.2, median="exact")
    # One of five models, that of strength 5, is trimmed from each field. The median of 0.6, 0.8, 1.0 and 1.1 is between 0.8 and 1.0.
    assert {(field, subject) for field, subject, _, _, dropped in found.trimming if dropped} == {(m, "4") for m in range(4)}
    rise = found.model[4, 31, 1] - found.model[0, 31, 1]
    assert 0.8 * 50 - 1e-6 <= rise <= 1.0 * 50 + 1e-6
    assert np.isnan(found.distances[4]) and found.dispersion < found.dispersion_untrimmed
    assert found.sums["greedy"] >= found.sums["exact"] - 1e-9 >= found.sums["lower_bound"] - 1e-6


def test_people_are_named_by_mappings(models):
    found = grimace.representative({"anna": models(1), "ben": [models(1), models(1.2)], "eva": models(0.9)}, alpha=0)
    assert found.sequences == [("anna", "001"), ("ben", "001"), ("ben", "002"), ("eva", "001")] and found.weighted


def test_trimming_is_a_table(models):
    pytest.importorskip("pandas")
    table = grimace.representative([models(s) for s in (1, 2, 3)], alpha=0.34).trimming_table()
    assert list(table) == ["field", "subject", "sequence", "distance", "dropped"] and table.dropped.sum() == 4


def test_models_that_do_not_go_together_are_refused(models):
    with pytest.raises(grimace.StatisticsError, match="0.5"):
        grimace.representative([models(1), models(2)], alpha=0.5)
    with pytest.raises(grimace.StatisticsError):
        grimace.representative([])
    with pytest.raises(grimace.StatisticsError, match="frames"):
        grimace.representative([models(1), models(1), models(1)[:3]])
    with pytest.raises(grimace.InputError, match=r"\(113, 2\)"):
        grimace.representative([models(1)[0]])
    with pytest.raises(TypeError, match="option"):
        grimace.run("a", "b", change={"statistics": {"alfa": 0.1}})


def test_groups_that_differ_are_told_from_groups_that_do_not(models):
    random = np.random.default_rng(1)
    weak = [models(s) for s in 0.8 + 0.1 * random.random(8)]
    strong = [models(s) for s in 1.4 + 0.1 * random.random(8)]
    (differ,) = grimace.compare({"weak": weak, "strong": strong}, permutations=999)
    assert differ.groups == ("weak", "strong") and differ.people == (8, 8) and differ.not_tested is None
    # Only the observed split, if it is drawn again, gives so large a value.
    assert differ.p <= 0.005 and differ.effect > 0.9 and differ.node_p.shape == (104,)
    (alike,) = grimace.compare({"some": weak[::2], "others": weak[1::2]})
    # There are 70 splits into groups of 4 and 4; all are tried.
    assert alike.permutations == 70 and alike.p > 0.05


def test_people_in_both_groups_are_not_tested(models):
    (comparison,) = grimace.compare({"a": {"anna": models(1), "ben": models(2)}, "b": {"anna": models(1), "eva": models(2)}})
    assert "anna" in comparison.not_tested and np.isnan(comparison.p)


def test_the_same_seed_gives_the_same(models):
    groups = {"a": [models(s) for s in np.linspace(1, 2, 12)], "b": [models(s) for s in np.linspace(1.1, 2.2, 12)]}
    first, second = (grimace.compare(groups, permutations=500, seed=3)[0].p for _ in range(2))
    assert first == second
