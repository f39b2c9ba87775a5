import csv
import signal
import threading
import time

import numpy as np
import pytest

import grimace


def test_a_track_has_every_node_of_every_frame(smile):
    assert len(smile) == 10 and smile.numbers.tolist() == list(range(1, 11))
    assert smile.positions.shape == (10, 113, 2) and smile.states.shape == smile.residuals.shape == (10, 113)
    assert set(smile.states[0]) == {"marked", "fitted", "follows"}
    # In the neutral frame the error of the position on the face, later the error of the motion.
    assert (smile.expected_errors[0] > 0).all() and np.nanmedian(smile.expected_errors[1:]) > 0
    assert smile.info["summary"]["verdict"] in {"good", "look again"} and smile.info["emotion"] == "happiness"


def test_pictures_in_memory_are_tracked_like_files(sample, tmp_path):
    image = pytest.importorskip("PIL.Image")
    folder = sample / "S001" / "005"
    marks = folder / "correspondences.csv"
    pictures = [image.open(path).convert("RGB") for path in sorted(folder.glob("*.jpg"))]
    for number, picture in enumerate(pictures, 1):
        picture.save(tmp_path / f"{number}.png")
    told = []
    of_arrays = grimace.track(
        np.stack([np.asarray(p) for p in pictures]), marks, progress=lambda done, total: told.append((done, total))
    )
    of_files = grimace.track(tmp_path, marks)
    np.testing.assert_array_equal(of_arrays.positions, of_files.positions)
    # Pictures of PIL are accepted as arrays.
    np.testing.assert_array_equal(grimace.track(pictures[:2], marks).positions, of_files.positions[:2])
    assert told[-1] == (10, 10) and told == sorted(told)


def test_a_track_is_near_the_truth(smile, sample):
    """The sample is simulated, so the true position of every node in every frame is known."""
    with open(sample / "truth" / "S001_005.csv", newline="") as file:
        truth = {(int(row["frame"]), int(row["node"])): (float(row["x"]), float(row["y"])) for row in csv.DictReader(file)}
    live = grimace.candide3().live
    last = np.array([truth[10, node] for node in live])
    first = np.array([truth[1, node] for node in live])
    moved = smile.positions[-1, live] - smile.positions[0, live]
    off = np.hypot(*(moved - (last - first)).T)
    # With eleven marks most nodes are not exactly at their true positions, and move slightly differently: the mean error is 1.3 % of the eye
    # distance.
    eyes = smile.info["summary"]["eye_distance_px"]
    assert off.mean() < 0.02 * eyes < np.hypot(*moved.T).max()


def test_tracks_are_written_and_read(smile, tmp_path):
    smile.write(tmp_path / "S001_005.csv")
    read = grimace.Track.read(tmp_path / "S001_005.csv")
    np.testing.assert_allclose(read.positions, smile.positions, rtol=1e-8)
    assert (read.states == smile.states).all() and read.info["sequence"] == "005" and read.size == smile.size
    with open(tmp_path / "S001_005.csv", newline="") as file:
        assert len(list(csv.DictReader(file))) == 10 * 113


def test_a_table_has_a_row_for_every_node(smile):
    pytest.importorskip("pandas")
    table = smile.table()
    assert list(table) == ["frame", "node", "x", "y", "state", "residual", "expected_error"] and len(table) == 1130
    row = table[(table.frame == 3) & (table.node == 31)].iloc[0]
    np.testing.assert_array_equal([row.x, row.y], smile.positions[2, 31])


def test_models_are_in_face_units(smile):
    model = grimace.normalize(smile)
    neutral = grimace.candide3().neutral
    assert model.shape == (5, 113, 2)
    np.testing.assert_allclose(model[0], neutral, atol=1e-6)
    # A smile moves the corners of the mouth up and apart: the left one to the subject's left.
    left, right = (model[4, 31] - neutral[31], model[4, 64] - neutral[64])
    assert left[1] > 20 and right[1] > 20 and left[0] > 10 > -10 > right[0]
    rolled = grimace.normalize(smile, pose="roll")
    np.testing.assert_allclose(grimace.normalize(smile.positions), rolled, atol=1e-6)
    with pytest.raises(TypeError, match="full"):
        grimace.normalize(smile.positions, pose="full")


def test_models_are_written_and_read(smile, tmp_path):
    model = grimace.normalize(smile)
    grimace.write_model(tmp_path / "m.csv", model)
    np.testing.assert_allclose(grimace.read_model(tmp_path / "m.csv"), model, atol=1e-5)


def test_what_cannot_be_tracked_is_said(sample, tmp_path):
    with pytest.raises(grimace.TrackError, match="no frames"):
        grimace.track([])
    with pytest.raises(grimace.InputError, match="nowhere"):
        grimace.track(tmp_path / "nowhere")
    frame = sample / "S001" / "005" / "S001_005_00000001.jpg"
    with pytest.raises(grimace.TrackError, match="at least 2 frames"):
        grimace.track([frame])
    with pytest.raises(grimace.TrackError, match="one size"):
        grimace.track([frame, np.zeros((10, 10), np.uint8)])


def test_an_error_of_the_callback_ends_the_call(sample):
    def refuse(done, total):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        grimace.track(sample / "S001" / "005", progress=refuse)


def test_ctrl_c_ends_a_long_call_and_other_threads_go_on(sample):
    paths = sorted((sample / "S001" / "005").glob("*.jpg"))
    # Forward and back, so often that tracking takes minutes.
    frames = (paths + paths[::-1]) * 200
    counted, ended, interrupted = [0], threading.Event(), []

    def others():
        while not ended.is_set():
            counted[0] += 1
            time.sleep(0.001)

    def tell(done, total):
        if done >= 3 and not interrupted:
            interrupted.append(done)
            counted.append(counted[0])
            signal.raise_signal(signal.SIGINT)

    thread = threading.Thread(target=others)
    thread.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            grimace.track(frames, progress=tell)
    finally:
        ended.set()
        thread.join()
    assert interrupted and interrupted[0] < len(frames) and counted[1] > 3


def test_a_tqdm_bar_serves_as_progress(sample):
    class Bar:
        n, total, refreshed = 0, None, 0

        def update(self, n=1): ...

        def refresh(self):
            self.refreshed += 1

    bar = Bar()
    grimace.track(sample / "S001" / "005", progress=bar)
    assert (bar.n, bar.total) == (10, 10) and bar.refreshed >= 1
