import shutil

import numpy as np
import pytest

import grimace


@pytest.fixture(scope="module")
def dataset(sample, tmp_path_factory):
    """Smiles and surprises of four people."""
    folder = tmp_path_factory.mktemp("dataset")
    header, *rows = (sample / "manifest.csv").read_text().splitlines()
    rows = [row for row in rows if row.split(",")[2] in ("happiness", "surprise")]
    assert len(rows) == 8
    (folder / "manifest.csv").write_text("\n".join([header, *rows]) + "\n")
    for row in rows:
        subject, sequence = row.split(",")[:2]
        shutil.copytree(sample / subject / sequence, folder / subject / sequence)
    return folder


@pytest.fixture(scope="module")
def ran(dataset, tmp_path_factory):
    told = []
    out = tmp_path_factory.mktemp("out") / "results"
    summary = grimace.run(dataset, out, by="cohort", no_faces=True, progress=lambda done, total: told.append((done, total)))
    return summary, out, told


def test_a_run_gives_representatives_tables_and_files(ran):
    summary, out, told = ran
    assert (summary.sequences, summary.tracked, summary.failures) == (8, 8, []) and told[-1] == (8, 8)
    assert ("happiness", 4) in summary.representatives and (out / "report.html").is_file()
    results = summary.results
    happiness = results.representative("happiness")
    models = {k: v for k, v in results.models().items() if k.endswith("_005")}
    assert len(models) == 4 and happiness.shape == (5, 113, 2)
    # The same statistics from the same models, read from files with nine digits.
    again = grimace.representative({name[:4]: model for name, model in models.items()})
    np.testing.assert_allclose(again.model, happiness, atol=1e-3)
    assert results.fap("happiness").value(12)[-1] > 0 and len(results.track("S001_005")) == 10
    assert results.record["options"]["by"] == ["cohort"]


def test_tables_are_data_frames(ran):
    pytest.importorskip("pandas")
    results = ran[0].results
    statistics = results.table("statistics")
    row = statistics[(statistics.emotion == "happiness")].iloc[0]
    assert row.sequences == 4 and row.dispersion > 0
    assert set(results.table("amplitudes").subject) == {"S001", "S002", "S003", "S004"}
    with pytest.raises(grimace.InputError, match="statistics"):
        results.table("nothing")


def test_run_again_changes_nothing_and_other_options_are_refused(ran, dataset):
    _, out, _ = ran
    again = grimace.run(dataset, out, by="cohort", no_faces=True)
    assert again.unchanged and again.tracked == 0
    with pytest.raises(grimace.RunError, match="force"):
        grimace.run(dataset, out, by="cohort", no_faces=True, alpha=0.2)
    changed = grimace.run(dataset, out, by="cohort", no_faces=True, change={"statistics": {"alpha": 0.2}}, force=True)
    assert changed.reused == 8


def test_an_interrupted_run_goes_on(dataset, tmp_path):
    def interrupt(done, total):
        if done >= 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        grimace.run(dataset, tmp_path / "out", progress=interrupt)
    summary = grimace.run(dataset, tmp_path / "out")
    assert summary.reused >= 1 and summary.tracked + summary.reused == 8


def test_a_dataset_that_is_none_is_said(tmp_path):
    with pytest.raises(grimace.RunError, match="nothing-here"):
        grimace.run(tmp_path / "nothing-here", tmp_path / "out")
    with pytest.raises(grimace.InputError, match="run.json"):
        grimace.Results(tmp_path)
