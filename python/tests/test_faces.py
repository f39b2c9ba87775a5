import numpy as np
import pytest

import grimace


def test_faces_are_found_and_their_points_are_near_the_hand_set_ones(portrait):
    (face,) = grimace.locate(portrait)
    assert face.trusted and face.score > 0
    marks = grimace.read_marks(str(portrait).replace(".jpg", "_correspondences.csv"))
    found = dict(zip(face.nodes.tolist(), face.points))
    shared = sorted(set(marks) & set(found))
    off = [np.hypot(*(found[n] - marks[n])) for n in shared]
    assert len(shared) >= 10 and np.median(off) < 0.03 * face.eye_distance


def test_a_picture_without_a_face_has_none():
    assert grimace.locate(np.full((200, 200), 127, np.uint8)) == []


def test_arrays_and_files_are_the_same_picture(smile, sample):
    image = pytest.importorskip("matplotlib.image")
    path = sample / "S001" / "005" / "S001_005_00000001.jpg"
    marks = sample / "S001" / "005" / "correspondences.csv"
    of_file = grimace.fit(path, marks)
    of_array = grimace.fit(image.imread(path), marks)
    assert of_file.nodes.shape == (113, 2) and of_file.size == of_array.size == smile.size
    np.testing.assert_allclose(of_file.nodes, of_array.nodes)
    np.testing.assert_allclose(of_file.nodes, smile.positions[0], atol=1e-6)


def test_marks_come_in_many_forms(sample):
    pandas = pytest.importorskip("pandas")
    folder = sample / "S001" / "005"
    image, path = folder / "S001_005_00000001.jpg", folder / "correspondences.csv"
    known = grimace.read_marks(path)
    rows = np.array([[n, *xy] for n, xy in known.items()])
    forms = [path, str(path), known, rows, pandas.read_csv(path, dtype={"node": str})]
    fits = [grimace.fit(image, form).nodes for form in forms]
    for nodes in fits[1:]:
        np.testing.assert_allclose(nodes, fits[0], atol=1e-9)
    # A feature point names a node: 8.3 is the left corner of the mouth, node 31.
    named = {("8.3" if n == 31 else n): xy for n, xy in known.items()}
    np.testing.assert_allclose(grimace.fit(image, named).nodes, fits[0], atol=1e-9)


def test_what_does_not_serve_is_said(sample):
    image = sample / "S001" / "005" / "S001_005_00000001.jpg"
    with pytest.raises(grimace.FitError, match="at least 3 are needed"):
        grimace.fit(image, {20: (1, 2)})
    with pytest.raises(grimace.FitError, match="999"):
        grimace.fit(image, {20: (1, 2), 23: (3, 4), 999: (5, 6)})
    with pytest.raises(grimace.InputError, match="uint8"):
        grimace.fit(np.zeros((10, 10)))
    with pytest.raises(grimace.InputError, match=r"\(2, 3, 4, 5\)"):
        grimace.fit(np.zeros((2, 3, 4, 5), np.uint8))
    with pytest.raises(grimace.LocateError, match="no face"):
        grimace.fit(np.full((100, 100), 9, np.uint8))
    with pytest.raises(grimace.InputError, match="no-such.png"):
        grimace.fit("no-such.png")
    with pytest.raises(ValueError, match="other"):
        grimace.fit(image, method="other")
    assert issubclass(grimace.FitError, grimace.GrimaceError)


def test_the_method_of_the_paper_is_another(sample):
    folder = sample / "S001" / "005"
    image, marks = folder / "S001_005_00000001.jpg", folder / "correspondences.csv"
    ours, kp = grimace.fit(image, marks), grimace.fit(image, marks, method="kp")
    assert np.abs(ours.nodes - kp.nodes).max() > 1
    np.testing.assert_array_equal(kp.nodes, grimace.fit(image, marks, prior="none").nodes)
