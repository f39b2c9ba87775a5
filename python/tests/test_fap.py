import numpy as np
import pytest

import grimace


def test_faps_of_a_model_are_written_and_read(models, tmp_path):
    fap = grimace.Fap.from_model(models(1), "my smile")
    assert fap.name == "my_smile" and fap.fps == 25 and fap.values.shape == (25, 68)
    path = tmp_path / "smile.fap"
    fap.write(path)
    read = grimace.Fap.read(path)
    np.testing.assert_array_equal(read.values, fap.values)
    # Only the corners of the outer lips move: FAPs 53 and 54 stretch them, 59 and 60 raise them. Xface would copy this to the inner lips.
    assert {finding.rule for finding in grimace.Fap.check(path)} == {"lips-mirrored"}
    for fap_number in (53, 54, 59, 60):
        assert read.value(fap_number)[0] == 0 < read.value(fap_number)[-1]
    read.write(path, profile="xface")
    assert grimace.Fap.check(path) == []
    with pytest.raises(grimace.FapError, match="low-level"):
        read.value(2)


def test_values_are_columns_by_number(tmp_path):
    values = np.full((2, 68), np.nan)
    values[:, 2] = [0, 100.4]
    fap = grimace.Fap("jaw", 25, values)
    fap.write(tmp_path / "jaw.fap")
    read = grimace.Fap.read(tmp_path / "jaw.fap")
    assert read.set_faps == [3] and read.value(3).tolist() == [0, 100]
    assert (tmp_path / "jaw.fap").read_text().splitlines()[0] == "2.1 jaw 25 2"


def test_a_table_has_the_faps_that_are_set(models):
    pytest.importorskip("pandas")
    fap = grimace.Fap.from_model(models(1))
    assert list(fap.table()) == [f"fap_{n}" for n in fap.set_faps]


def test_deviations_and_errors_are_told(tmp_path):
    path = tmp_path / "bad.fap"
    path.write_text("2.1 bad 25 1\n1 0\n0\n")
    findings = grimace.Fap.check(path)
    assert findings[0].line == 2 and findings[0].severity == "error" and findings[0].rule == "mask-count"
    with pytest.raises(grimace.FapError, match="bad.fap"):
        grimace.Fap.read(path)
    with pytest.raises(ValueError, match="strict"):
        grimace.Fap("x", 25, np.zeros((1, 68))).write(tmp_path / "x.fap", profile="maya")
    with pytest.raises(grimace.FapError, match="68"):
        grimace.Fap("x", 25, np.zeros((1, 3))).write(tmp_path / "x.fap")
