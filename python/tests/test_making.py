import numpy as np
import pytest

import grimace


def test_an_expression_on_a_portrait(models, portrait):
    marks = str(portrait).replace(".jpg", "_correspondences.csv")
    clone = grimace.clone(models(1), portrait, marks, duration=0.2)
    # A fifth of a second at 25 frames per second: five steps, six frames.
    assert clone.frames.shape[0] == 6 == len(clone.nodes) and clone.frames.dtype == np.uint8 and clone.apex == 5
    left, right = clone.nodes[5] - clone.nodes[0], clone.frames[5].astype(int) - clone.frames[0]
    # The subject's left corner of the mouth moves to the right in the picture, and up.
    assert left[31, 0] > 3 and left[31, 1] < -3 and np.abs(right).max() > 30
    same = grimace.clone(models(0), portrait, marks, duration=0.04)
    assert np.abs(same.frames[1].astype(int) - same.frames[0]).max() <= 1


def test_sources_of_every_kind_move_alike(models, portrait, tmp_path):
    marks = str(portrait).replace(".jpg", "_correspondences.csv")
    model = models(1)
    grimace.write_model(tmp_path / "m.csv", model)
    representative = grimace.representative([model, model])
    of_model = grimace.clone(model, portrait, marks, duration=0.04).nodes
    for source in (tmp_path / "m.csv", representative):
        np.testing.assert_allclose(grimace.clone(source, portrait, marks, duration=0.04).nodes, of_model, atol=1e-3)
    fap = grimace.Fap.from_model(model)
    of_fap = grimace.clone(fap, portrait, marks, duration=0.04).nodes
    corner = lambda nodes: nodes[-1, 31] - nodes[0, 31]
    np.testing.assert_allclose(corner(of_fap), corner(of_model), atol=1)


def test_a_track_is_a_source(smile, portrait):
    clone = grimace.clone(smile, portrait, duration=0.08)
    assert clone.fps == 25 and clone.nodes[-1, 31, 1] < clone.nodes[0, 31, 1]


def test_what_does_not_serve_is_said(models, portrait):
    with pytest.raises(grimace.CloneError, match="no-such.fap"):
        grimace.clone("no-such.fap", portrait)
    with pytest.raises(ValueError, match="sideways"):
        grimace.clone(models(1), portrait, rescale="sideways")
    with pytest.raises(grimace.LocateError):
        grimace.clone(models(1), np.full((50, 50, 3), 200, np.uint8))


def test_a_motion_on_a_bank(smile, tmp_path):
    made = grimace.synthesize(grimace.normalize(smile), gltf=tmp_path / "smile.glb")
    # Five key frames, with five frames between every two.
    frames, vertices = 25, len(made.neutral)
    assert made.surface.shape == (frames, vertices, 3) and made.triangles.max() < vertices
    assert made.weights.shape == (frames, 1, len(made.members)) and made.fps == 25
    assert np.isnan(made.shown[0]) and 0.3 < made.shown[-1] <= 1
    assert np.isnan(made.fitness[0]) and made.fitness[-1] > 0.5 and np.abs(made.surface[0]).max() == 0
    assert (tmp_path / "smile.glb").read_bytes()[:4] == b"glTF"
    of_fap = grimace.synthesize(grimace.Fap.from_model(grimace.normalize(smile)))
    assert of_fap.fitness[-1] > 0.5
    again = grimace.synthesize(grimace.normalize(smile))
    np.testing.assert_array_equal(made.weights, again.weights)


def test_options_of_the_synthesis(smile):
    model = grimace.normalize(smile)
    made = grimace.synthesize(model, solver="ga", regions="halves", generations=5, between=0)
    assert made.weights.shape[:2] == (5, 2)
    with pytest.raises(grimace.SynthesisError, match="emphasis"):
        grimace.synthesize(model, emphasis=-1)
    with pytest.raises(grimace.SynthesisError, match="no.bank"):
        grimace.synthesize(model, bank="no.bank")
