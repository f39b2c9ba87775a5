//! The data of a player's page: motions, faces and FAPs as JSON.

use image::{RgbImage, codecs::jpeg::JpegEncoder};
use nalgebra::Point2;
use serde_json::{Value, json};

use super::{
    Shown,
    names::{fap_in_words, part_of},
    pack,
};
use crate::{
    clone::{
        CloneError, LID_PAIRS, MOST_SKIN, NO_CHANGE, SKIN_LOG_LIMIT, Skin, SourceKind, SourceMotion, Target, at_height,
        fold_powers, fold_softening, places_on_skin,
    },
    fap::{FapCatalog, FapFrame, FapMotion, FapNumber, FapRow, FapSequence},
    model::{DynamicExpressionModel, FrameExpressionModel},
    normalize::{NormalizeOptions, Normalizer},
    overlay::png_bytes,
    units::{FaceUnit, NodeId},
    warp::{
        Opening, RigOpening, TEETH_PICTURES,
        furrows::{self, Furrows},
        hollow::{self, Hollow},
        lash_line, lashes,
        lid_skin::{self, LidSkin},
        shut_lid,
    },
    wireframe::{Face as Wire, Fapu, Fapus},
};

/// Quality of the JPEG of a face, 1 to 100.
const QUALITY: u8 = 88;
/// Largest value of a FAP's slider in either direction: one FAPU for lengths, about 23 degrees for angles (in 1e-5 rad).
const MOST_LENGTH: i32 = 1024;
const MOST_ANGLE: i32 = 40_000;

/// Why a player cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum PlayerError {
    /// A motion or a face cannot be prepared.
    #[error(transparent)]
    Clone(#[from] CloneError),
    /// The FAPs of a motion cannot be computed.
    #[error("{name}: {reason}")]
    Faps {
        /// The motion.
        name: String,
        /// Why.
        reason: String,
    },
    /// A picture cannot be encoded.
    #[error("cannot encode the picture of {name}: {reason}")]
    Picture {
        /// The face.
        name: String,
        /// Why.
        reason: String,
    },
    /// A dense head cannot be shown.
    #[error("{name}: {reason}")]
    Head {
        /// The head.
        name: String,
        /// Why.
        reason: String,
    },
    /// The page cannot be rendered (a programming error).
    #[error("cannot create the page: {0}")]
    Page(String),
}

/// A face to show motions on.
#[derive(Clone, Copy, Debug)]
pub struct Face<'a> {
    /// Label of the face.
    pub label: &'a str,
    /// The photograph and the wireframe on it.
    pub target: &'a Target,
    /// Height of the picture in the page, px; a smaller picture is not enlarged.
    pub height: u32,
}

/// Builds the data of a player.
///
/// # Errors
/// [`PlayerError`] for a motion without FAPs, or a picture that cannot be encoded.
pub fn payload(motions: &[Shown], faces: &[Face], wire: &Wire) -> Result<Value, PlayerError> {
    let normalizer = Normalizer::new(&wire.wireframe, &wire.tables, NormalizeOptions::default())
        .map_err(|source| CloneError::Fapus { what: "the wireframe", source })?;
    let canonical = normalizer.canonical();
    let motions = motions.iter().map(|m| motion(m, &canonical.neutral, &canonical.fapus, wire)).collect::<Result<Vec<_>, _>>()?;
    let (scale, origin, white) = TEETH_PICTURES;
    Ok(json!({
        "motions": motions,
        "faces": faces.iter().map(face).collect::<Result<Vec<_>, _>>()?,
        "faps": faps(wire)?,
        // FAPUs along x and y of every node, as indices in the list of lengths.
        "nodeFapus": (0..wire.wireframe.node_count())
            .map(|n| wire.tables.node_fapus(NodeId(n as u16)))
            .flat_map(|(x, y)| [x, y].map(place_of))
            .collect::<Vec<_>>(),
        "canonical": { "fapus": lengths(&canonical.fapus), "lids": crate::clone::canonical_lid_gaps(canonical) },
        "lidPairs": LID_PAIRS,
        // Meaning of the levels of a skin change, and its greatest strength.
        "folds": { "none": NO_CHANGE, "limit": SKIN_LOG_LIMIT, "most": MOST_SKIN, "unit": place_of(Fapu::Es) },
        // Constants of the skin of a shutting lid, the same for every face.
        "lidSkin": {
            "shut": lid_skin::SHUT,
            "leastBand": lid_skin::LEAST_BAND,
            "ends": lid_skin::ENDS,
            "folded": lid_skin::FOLDED,
            "strips": lid_skin::STRIPS,
            "grain": lid_skin::GRAIN,
            "clear": lid_skin::CLEAR,
            // Those of lashes below a rising brow.
            "drawnOut": lashes::DRAWN_OUT,
            "darkest": lashes::DARKEST,
            "floor": lashes::FLOOR,
            "beyond": lashes::BEYOND,
        },
        // Those of the form and grain of a shut lid, and of the line of lashes where lids meet.
        "shutLid": {
            "zone": shut_lid::ZONE,
            "leastWay": shut_lid::LEAST_WAY,
            "form": [shut_lid::BRIGHTEST, shut_lid::DARKER[0], shut_lid::DARKER[1], shut_lid::SIDES],
            "below": shut_lid::BELOW,
            "grain": [shut_lid::AROUND, shut_lid::GRAIN, shut_lid::MOST, shut_lid::DARK / 255.0],
        },
        "lashLine": {
            "closing": lash_line::CLOSING,
            "meeting": lash_line::MEETING,
            "width": lash_line::WIDTH,
            "leastWidth": lash_line::LEAST_WIDTH,
            "corners": lash_line::CORNERS,
            "above": lash_line::ABOVE,
            "below": lash_line::BELOW,
            "hair": lash_line::HAIR,
            "share": lash_line::HAIR_SHARE,
            "hairs": lash_line::HAIRS,
            "lean": lash_line::LEAN,
            "apart": lash_line::APART,
        },
        // Those of the shade that fades and the furrows that deepen as brows rise.
        "hollow": {
            "columns": hollow::COLUMNS,
            "rows": hollow::ROWS,
            "along": hollow::ALONG,
            "darkest": hollow::DARKEST,
            "lighter": hollow::LIGHTER,
            "most": hollow::MOST,
        },
        "furrows": { "parts": furrows::PARTS, "deepen": furrows::DEEPEN, "most": furrows::MOST, "limit": furrows::LIMIT },
        "teeth": { "scale": scale, "origin": [origin.0, origin.1], "white": white },
    }))
}

fn place_of(fapu: Fapu) -> usize {
    Fapu::LENGTHS.iter().position(|&f| f == fapu).unwrap_or(1)
}

fn lengths(fapus: &Fapus) -> Vec<f64> {
    Fapu::LENGTHS.iter().map(|&f| fapus.length(f).unwrap_or(fapus.es)).collect()
}

/// A motion: offsets of all nodes, its timing, and its FAPs.
fn motion(shown: &Shown, neutral: &FrameExpressionModel<FaceUnit>, canonical: &Fapus, wire: &Wire) -> Result<Value, PlayerError> {
    // The page shows evenly spaced frames.
    let motion = &shown.motion.evenly()?;
    let flat: Vec<f64> = motion.offsets.iter().flatten().flat_map(|o| [o.x, o.y]).collect();
    Ok(json!({
        "name": motion.name,
        "label": shown.label,
        "kind": match motion.kind { SourceKind::Track => "track", SourceKind::Model => "model", SourceKind::Fap => "fap" },
        "frames": motion.frame_count(),
        "seconds": motion.seconds(),
        "fapus": lengths(&motion.fapus),
        "lids": motion.lid_gaps,
        "offsets": pack::scaled(&flat),
        "faps": curves(motion, neutral, canonical, wire)?,
        "folds": folds(&motion.name, shown.skin)?,
        "apex": motion.apex(),
    }))
}

/// The folds that grow with a motion: levels on the layout of skin changes, on which the faces place their vertices.
fn folds(name: &str, skin: &Skin) -> Result<Value, PlayerError> {
    let mut bytes = Vec::new();
    skin.write_in_face(&mut bytes).map_err(|e| PlayerError::Picture { name: name.to_owned(), reason: e.to_string() })?;
    Ok(json!({ "picture": pack::data_url("image/png", &bytes), "lighter": skin.lighter() }))
}

/// The FAPs that move (for a FAP file, those that it sets): number, and value in every frame.
fn curves(
    motion: &SourceMotion,
    neutral: &FrameExpressionModel<FaceUnit>,
    canonical: &Fapus,
    wire: &Wire,
) -> Result<Vec<(u8, Value)>, PlayerError> {
    let failed = |reason: String| PlayerError::Faps { name: motion.name.clone(), reason };
    let ratio = |fapu: Fapu| match (canonical.length(fapu), motion.fapus.length(fapu)) {
        (Some(to), Some(from)) => to / from,
        _ => canonical.es / motion.fapus.es,
    };
    let scales: Vec<(f64, f64)> = (0..neutral.node_count())
        .map(|n| {
            let (x, y) = wire.tables.node_fapus(NodeId(n as u16));
            (ratio(x), ratio(y))
        })
        .collect();
    let frame = |offsets: &Vec<nalgebra::Vector2<f64>>| {
        let moved = neutral.nodes().iter().zip(offsets).zip(&scales);
        FrameExpressionModel::new(moved.map(|((p, o), s)| Point2::new(p.x + o.x * s.0, p.y + o.y * s.1)).collect())
    };
    // FAPs are offsets from neutral, and a FAP file need not begin with neutral.
    let frames = std::iter::once(neutral.clone()).chain(motion.offsets.iter().map(frame));
    let model = DynamicExpressionModel::new(frames.collect()).map_err(|e| failed(e.to_string()))?;
    let (sequence, _) =
        FapSequence::from_measured(&model, (canonical, motion.lid_units()), FapCatalog::mpeg4(), &motion.name, 25, 0)
            .map_err(|e| failed(e.to_string()))?;
    let values = |fap: FapNumber| sequence.frames.iter().skip(1).map(move |f| f.value(fap).unwrap_or(0.0));
    let moving = FapNumber::low_level().filter(|&fap| motion.asks_for(fap) && values(fap).any(|v| v != 0.0));
    Ok(moving.map(|fap| (fap.get(), pack::scaled(&values(fap).collect::<Vec<_>>()))).collect())
}

/// The FAPs that show from the front: description, range of the slider, and the offsets of all nodes at one unit, in face units.
fn faps(wire: &Wire) -> Result<Vec<Value>, PlayerError> {
    let shows = |row: &&FapRow| {
        row.fapu.is_some()
            && row.motion.and_then(FapMotion::frontal_axis).is_some()
            && !row.nodes.is_empty()
            && row.frontal.is_measured()
    };
    FapCatalog::mpeg4().rows().iter().filter(shows).map(|row| fap(row, wire)).collect()
}

fn fap(row: &FapRow, wire: &Wire) -> Result<Value, PlayerError> {
    let is_angle = row.motion.is_some_and(FapMotion::is_angle);
    let most = if is_angle { MOST_ANGLE } else { MOST_LENGTH };
    let (least, greatest) = row.range.unwrap_or((-most, most));
    let mut frame = FapFrame::default();
    // The springs are linear, so any value gives the offsets of one unit.
    let probe = if is_angle { 10_000.0 } else { 100.0 };
    frame.set_value(row.number, Some(probe));
    let sequence = FapSequence { version: "2.1".to_owned(), name: row.name.clone(), fps: 25.0, frames: vec![frame] };
    let motion = SourceMotion::from_fap(&row.name, &sequence, wire)?;
    let offsets = motion.offsets.last().into_iter().flatten();
    let flat: Vec<f64> = offsets.flat_map(|o| [o.x / probe, o.y / probe]).collect();
    Ok(json!({
        "number": row.number.get(),
        "name": row.name,
        "words": fap_in_words(&row.name),
        "part": part_of(row.number.get()),
        "unit": row.unit_name(),
        "nodes": row.nodes,
        "range": [least.max(-most), greatest.min(most)],
        "step": step(is_angle, least.max(-most), greatest.min(most)),
        "offsets": pack::scaled(&flat),
    }))
}

/// Step of a slider: 0 must lie on its grid, which begins at the least value.
fn step(is_angle: bool, least: i32, greatest: i32) -> i32 {
    let steps = if is_angle { [400, 200, 100] } else { [8, 4, 2] };
    steps.into_iter().find(|step| least % step == 0 && greatest % step == 0).unwrap_or(1)
}

/// A face: its cropped picture, and everything that moves it, in pixels of that picture.
fn face(face: &Face) -> Result<Value, PlayerError> {
    let target = face.target;
    let (left, top, width, height) = target.surroundings();
    let crop = image::imageops::crop_imm(&target.picture, left, top, width, height).to_image();
    let picture = at_height(&crop, face.height.min(height));
    let scale = f64::from(picture.height()) / f64::from(height.max(1));
    // Pixel centres have integer coordinates both before and after scaling.
    let place = |p: &Point2<f64>| {
        let shift = |v: f64, origin: u32| (v - f64::from(origin) + 0.5) * scale - 0.5;
        [shift(p.x, left), shift(p.y, top)]
    };
    let places = |points: &[Point2<f64>]| pack::single(points.iter().flat_map(place));
    let rig = target.warp().rig(target.texture());
    let teeth = png_bytes(&rig.teeth).map_err(|e| PlayerError::Picture { name: face.label.to_owned(), reason: e.to_string() })?;
    let least = rig.least_areas.iter().map(|a| if a.is_finite() { a * scale * scale } else { -1e30 });
    Ok(json!({
        "label": face.label,
        "picture": pack::data_url("image/jpeg", &jpeg(face.label, &picture)?),
        "width": picture.width(),
        "height": picture.height(),
        "given": places(&rig.given),
        "nodes": places(&rig.nodes),
        "vertices": places(&rig.vertices),
        "skin": pack::whole(rig.skin.iter().flatten().copied()),
        "leastAreas": pack::single(least),
        "drivers": rig.drivers,
        "weights": pack::scaled(&rig.weights),
        "neighbours": rig.neighbours,
        "partners": rig.partners,
        "openings": rig.openings.iter().map(|o| opening(o, place, scale)).collect::<Vec<_>>(),
        "bows": rig.bows.each_ref().map(|edge| edge.iter().map(|(v, bow)| json!([v, (bow * scale) as f32])).collect::<Vec<_>>()),
        "furrows": rig.furrows.as_ref().map(|f| furrows_of(face.label, f, place(&f.from), scale)).transpose()?,
        "closed": rig.closed,
        "unit": rig.eye_distance * scale,
        "softness": rig.softness * scale,
        "down": [rig.down.x, rig.down.y],
        "roll": target.roll,
        "fapus": lengths(&target.fapus.scaled(scale)),
        "lids": target.lid_gaps().map(|gap| gap * scale),
        "lip": rig.lip,
        "enamel": rig.enamel,
        "flesh": rig.flesh,
        "teeth": pack::data_url("image/png", &teeth),
        "teethSize": rig.teeth_size,
        "inside": rig.inside,
        "onSkin": pack::single(places_on_skin(target)?.iter().flat_map(|p| [p.x, p.y])),
        "foldPowers": fold_powers(target),
        "foldSoftening": fold_softening(target),
        "tone": { "lines": rig.tone.0, "share": rig.tone.1 },
    }))
}

/// The skin of an upper lid. Lengths are in pixels of the face's picture, in which the outer corner of the eye lies at `from`.
fn lid_skin(lid: &LidSkin, from: [f64; 2], scale: f64) -> Value {
    let lengths = |list: &[f64]| pack::single(list.iter().map(|v| v * scale));
    json!({
        "from": from,
        "across": [lid.across.x * scale, lid.across.y * scale],
        "edge": lengths(&lid.edge),
        "band": lengths(&lid.band),
        "fade": lid.fade * scale,
        "shut": lid.shut,
        "skin": pack::single(lid.skin.iter().flatten().map(|&level| f64::from(level))),
    })
}

/// The shade between a brow and a lid; lengths in pixels of the face's picture.
fn hollow_of(hollow: &Hollow, scale: f64) -> Value {
    json!({
        "brow": pack::single(hollow.brow.iter().map(|v| v * scale)),
        "logs": pack::single(hollow.logs.iter().flatten().map(|&log| f64::from(log))),
    })
}

/// The furrows of a forehead; `from` is the position of their picture in the face's.
fn furrows_of(name: &str, furrows: &Furrows, from: [f64; 2], scale: f64) -> Result<Value, PlayerError> {
    let bytes = png_bytes(&furrows.picture).map_err(|e| PlayerError::Picture { name: name.to_owned(), reason: e.to_string() })?;
    Ok(json!({
        "picture": pack::data_url("image/png", &bytes),
        "from": from,
        "across": [furrows.across.x * scale, furrows.across.y * scale],
        "up": [furrows.up.x * scale, furrows.up.y * scale],
    }))
}

/// An opening; for an eye, with the skin of its upper lid. `place` and `scale` map to the face's picture.
fn opening(opening: &RigOpening, place: impl Fn(&Point2<f64>) -> [f64; 2], scale: f64) -> Value {
    json!({
        "kind": match opening.opening { Opening::Mouth => "mouth", Opening::LeftEye => "left eye", Opening::RightEye => "right eye" },
        "upper": opening.upper,
        "lower": opening.lower,
        "eyeball": opening.eyeball,
        "stops": opening.stops,
        "triangles": opening.triangles.iter().flatten().collect::<Vec<_>>(),
        "upperNodes": opening.upper_nodes,
        "lowerNodes": opening.lower_nodes,
        "iris": opening.iris,
        "lashes": opening.lashes,
        "brow": opening.brow,
        "lid": opening.lid.as_ref().map(|lid| lid_skin(lid, place(&lid.from), scale)),
        "hollow": opening.hollow.as_ref().map(|hollow| hollow_of(hollow, scale)),
    })
}

fn jpeg(name: &str, picture: &RgbImage) -> Result<Vec<u8>, PlayerError> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, QUALITY)
        .encode_image(picture)
        .map_err(|e| PlayerError::Picture { name: name.to_owned(), reason: e.to_string() })?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use base64::{Engine, prelude::BASE64_STANDARD};

    use super::*;
    use crate::clone::test_target::portrait_target;

    #[test]
    fn the_skin_of_lids_is_that_of_the_library() {
        let target = portrait_target();
        let (left, top, _, height) = target.surroundings();
        let numbers = |packed: &Value| -> Vec<f64> {
            let bytes = BASE64_STANDARD.decode(packed.as_str().unwrap()).unwrap();
            bytes.chunks_exact(4).map(|four| f64::from(f32::from_le_bytes(four.try_into().unwrap()))).collect()
        };
        // At its own size, and at half of it.
        for (most, scale) in [(height, 1.0), (height / 2, f64::from(height / 2) / f64::from(height))] {
            let shown = face(&Face { label: "P01", target, height: most }).unwrap();
            assert!(shown["openings"][0]["lid"].is_null(), "a mouth has no lid");
            for k in [1, 2] {
                let lid = target.warp().rig(target.texture()).openings[k].lid.clone().unwrap();
                let packed = &shown["openings"][k]["lid"];
                let is_near = |list: &Value, expected: &[f64]| {
                    let got: Vec<f64> =
                        list.as_array().map_or_else(|| numbers(list), |l| l.iter().map(|v| v.as_f64().unwrap()).collect());
                    assert!(got.len() == expected.len() && got.iter().all(|v| v.is_finite()), "{got:?}");
                    assert!(got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{got:?}, expected {expected:?}");
                };
                let place = |v: f64, origin: u32| (v - f64::from(origin) + 0.5) * scale - 0.5;
                is_near(&packed["from"], &[place(lid.from.x, left), place(lid.from.y, top)]);
                is_near(&packed["across"], &[lid.across.x * scale, lid.across.y * scale]);
                is_near(&packed["edge"], &lid.edge.iter().map(|v| v * scale).collect::<Vec<_>>());
                is_near(&packed["band"], &lid.band.iter().map(|v| v * scale).collect::<Vec<_>>());
                is_near(&packed["skin"], &lid.skin.iter().flatten().map(|&v| f64::from(v)).collect::<Vec<_>>());
                assert!(lid.edge.len() == 28 && lid.skin.len() == 28 && lid.band.iter().all(|&v| v > 0.0));
            }
        }
    }

    #[test]
    fn faps_of_a_file_that_does_not_begin_at_rest_are_its_own() {
        let wire = Wire::candide3();
        let normalizer = Normalizer::new(&wire.wireframe, &wire.tables, NormalizeOptions::default()).unwrap();
        let canonical = normalizer.canonical();
        // FAP 3 opens the jaw from half to all the way, and FAP 31 holds a brow up.
        let frame = |jaw: f64| {
            let mut frame = FapFrame::default();
            for (fap, value) in [(3, jaw), (31, 200.0)] {
                frame.set_value(FapNumber::try_from(fap).unwrap(), Some(value));
            }
            frame
        };
        for values in [&[500.0, 750.0, 1000.0][..], &[500.0, 500.0]] {
            let frames = values.iter().map(|&jaw| frame(jaw)).collect();
            let sequence = FapSequence { version: "2.1".to_owned(), name: "open".to_owned(), fps: 25.0, frames };
            let motion = SourceMotion::from_fap("open", &sequence, &wire).unwrap();
            let shown = curves(&motion, &canonical.neutral, &canonical.fapus, &wire).unwrap();
            assert_eq!(shown.iter().map(|(fap, _)| *fap).collect::<Vec<_>>(), [3, 31]);
            let is_near = |(_, packed): &(u8, Value), expected: &[f64]| {
                let (scale, bytes) = (packed["scale"].as_f64().unwrap(), packed["values"].as_str().unwrap());
                let bytes = BASE64_STANDARD.decode(bytes).unwrap();
                let found = bytes.chunks_exact(2).map(|two| f64::from(i16::from_le_bytes(two.try_into().unwrap())) * scale);
                let found: Vec<f64> = found.collect();
                assert!(
                    found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 2.0),
                    "{found:?}"
                );
            };
            is_near(&shown[0], values);
            is_near(&shown[1], &vec![200.0; values.len()]);
        }
    }

    #[test]
    fn zero_lies_on_the_grid_of_every_slider() {
        for slider in faps(&Wire::candide3()).unwrap() {
            let number = |key: &serde_json::Value| key.as_i64().unwrap();
            let (least, greatest, step) = (number(&slider["range"][0]), number(&slider["range"][1]), number(&slider["step"]));
            assert!(
                least <= 0 && least % step == 0 && greatest % step == 0,
                "{}: {least} to {greatest} by {step}",
                slider["name"]
            );
        }
        assert_eq!((step(false, -1024, 1024), step(false, -420, 420), step(true, -40_000, 40_000)), (8, 4, 400));
    }
}
