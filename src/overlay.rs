//! Pictures of the wireframe on a frame, for checking a fit or a track by eye.

use image::{ImageBuffer, PixelWithColorType, RgbImage, imageops::FilterType};
use nalgebra::{Point2, Point3};
use tiny_skia::{Color, FillRule, LineCap, Paint, Path as SkiaPath, PathBuilder, Pixmap, Stroke, Transform};

use crate::{
    pose::HeadPose,
    sequence::{Frame, colour_of},
    track::{LossReason, NodeState, TrackedNode},
    wireframe::Wireframe,
};

/// Width up to which pictures are shown as they are, px.
const SCREEN_WIDTH: f32 = 1280.0;
/// Least width of a picture, px; smaller frames are enlarged by an integer factor so that thin lines stay readable.
const MIN_WIDTH: u32 = 900;

/// Largest enlargement.
const MAX_FACTOR: u32 = 4;

/// Colour of each state, from a palette for colour-blind people (Okabe and Ito).
fn colour(state: NodeState) -> [u8; 3] {
    match state {
        NodeState::Marked => [240, 228, 66],
        NodeState::Corrected => [255, 255, 255],
        NodeState::Fitted | NodeState::Follows => [86, 180, 233],
        NodeState::Tracked => [0, 178, 130],
        NodeState::Recovered(LossReason::Klt) => [213, 94, 0],
        NodeState::Recovered(LossReason::ForwardBackward) => [230, 159, 0],
        NodeState::Recovered(LossReason::Extreme) => [204, 121, 167],
        NodeState::Recovered(LossReason::Jump) => [0, 114, 178],
        NodeState::Recovered(LossReason::Outside | LossReason::NoLandmark | LossReason::LostFrame) => [20, 20, 20],
    }
}

/// States and their colours, for a legend.
pub fn legend() -> Vec<(NodeState, [u8; 3])> {
    let lost = [LossReason::Klt, LossReason::ForwardBackward, LossReason::Extreme, LossReason::Jump, LossReason::Outside];
    let states = [NodeState::Marked, NodeState::Fitted, NodeState::Tracked].into_iter();
    states.chain(lost.map(NodeState::Recovered)).map(|s| (s, colour(s))).collect()
}

/// Draws the wireframe on the frame: springs as lines, live nodes as dots in the colour of their state, and marks as rings at their
/// positions (px of the image).
pub fn draw_overlay(frame: &Frame, wireframe: &Wireframe, nodes: &[TrackedNode], marks: &[Point2<f64>]) -> RgbImage {
    let gray = frame.image();
    let factor = MIN_WIDTH.div_ceil(gray.width().max(1)).clamp(1, MAX_FACTOR);
    let large = image::imageops::resize(gray, gray.width() * factor, gray.height() * factor, FilterType::CatmullRom);
    let Some(mut canvas) = Pixmap::new(large.width(), large.height()) else {
        return colour_of(&large);
    };
    for (pixel, luma) in canvas.data_mut().chunks_exact_mut(4).zip(large.as_raw()) {
        pixel.copy_from_slice(&[*luma, *luma, *luma, 255]);
    }
    // Pixel centres have integer coordinates in image space and half-integers on the canvas.
    let scale = f64::from(factor);
    let at = |p: &Point2<f64>| (((p.x + 0.5) * scale) as f32, ((p.y + 0.5) * scale) as f32);
    let width = line_width(gray.width()) * factor as f32;
    draw_nodes(&mut canvas, wireframe, nodes, at, width);
    for mark in marks {
        let (x, y) = at(mark);
        if let Some(ring) = PathBuilder::from_circle(x, y, width * 4.2) {
            stroke(&mut canvas, &ring, [10, 20, 30, 200], width * 1.9);
            stroke(&mut canvas, &ring, [240, 228, 66, 255], width);
        }
    }
    let rgb = canvas.data().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    RgbImage::from_raw(large.width(), large.height(), rgb).unwrap_or_default()
}

/// Draws the wireframe of [`draw_overlay`] on a colour picture at its own size.
pub fn draw_on_colour(picture: &RgbImage, wireframe: &Wireframe, nodes: &[TrackedNode]) -> RgbImage {
    let Some(mut canvas) = Pixmap::new(picture.width(), picture.height()) else { return picture.clone() };
    for (pixel, rgb) in canvas.data_mut().chunks_exact_mut(4).zip(picture.pixels()) {
        pixel.copy_from_slice(&[rgb[0], rgb[1], rgb[2], 255]);
    }
    draw_nodes(&mut canvas, wireframe, nodes, |p| ((p.x + 0.5) as f32, (p.y + 0.5) as f32), line_width(picture.width()));
    let rgb = canvas.data().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    RgbImage::from_raw(picture.width(), picture.height(), rgb).unwrap_or_default()
}

/// Width of lines on a picture of this width, px: pictures larger than a screen are looked at in a smaller size.
fn line_width(picture: u32) -> f32 {
    0.9 * (picture as f32 / SCREEN_WIDTH).max(1.0)
}

/// Draws springs as lines and live nodes as dots in the colour of their state.
fn draw_nodes(
    canvas: &mut Pixmap,
    wireframe: &Wireframe,
    nodes: &[TrackedNode],
    at: impl Fn(&Point2<f64>) -> (f32, f32),
    width: f32,
) {
    if let Some(path) = springs(wireframe, nodes, &at) {
        stroke(canvas, &path, [10, 20, 30, 90], width * 1.9);
        stroke(canvas, &path, [235, 245, 255, 150], width * 0.8);
    }
    for &node in wireframe.live_nodes() {
        if let Some(node) = nodes.get(node.index()) {
            let (x, y) = at(&node.position);
            dot(canvas, x, y, width * 2.1, [10, 20, 30]);
            dot(canvas, x, y, width * 1.6, colour(node.state));
        }
    }
}

/// Length of a head's axes in model units: a little more than the eye distance.
const AXIS: f64 = 0.75;
/// Colours of the axes: to the subject's left, up, out of the face.
const AXIS_COLOURS: [[u8; 3]; 3] = [[213, 94, 0], [86, 180, 233], [240, 228, 66]];

/// Draws the axes of a head on a picture of [`draw_overlay`], from the middle of the head: orange to the subject's left, blue up, yellow
/// out of the face. `width` is the frame's width, px.
pub fn draw_axes(picture: &mut RgbImage, width: u32, pose: &HeadPose) {
    let scale = f64::from(picture.width()) / f64::from(width.max(1));
    let Some(mut canvas) = Pixmap::new(picture.width(), picture.height()) else { return };
    for (pixel, rgb) in canvas.data_mut().chunks_exact_mut(4).zip(picture.pixels()) {
        pixel.copy_from_slice(&[rgb[0], rgb[1], rgb[2], 255]);
    }
    let at = |p: Point2<f64>| (((p.x + 0.5) * scale) as f32, ((p.y + 0.5) * scale) as f32);
    let thick = (0.012 * pose.scale * scale).max(1.5) as f32;
    let (x, y) = at(pose.project(&Point3::origin()));
    let ends = [Point3::new(AXIS, 0.0, 0.0), Point3::new(0.0, AXIS, 0.0), Point3::new(0.0, 0.0, AXIS)];
    for (end, [r, g, b]) in ends.into_iter().zip(AXIS_COLOURS) {
        let (to_x, to_y) = at(pose.project(&end));
        let mut line = PathBuilder::new();
        line.move_to(x, y);
        line.line_to(to_x, to_y);
        if let Some(line) = line.finish() {
            stroke(&mut canvas, &line, [10, 20, 30, 220], thick * 1.8);
            stroke(&mut canvas, &line, [r, g, b, 255], thick);
        }
        dot(&mut canvas, to_x, to_y, thick * 1.9, [10, 20, 30]);
        dot(&mut canvas, to_x, to_y, thick * 1.4, [r, g, b]);
    }
    for (rgb, pixel) in picture.pixels_mut().zip(canvas.data().chunks_exact(4)) {
        rgb.0 = [pixel[0], pixel[1], pixel[2]];
    }
}

/// Draws a small picture of the face with the wireframe, cropped around the nodes, `height` px high.
pub fn thumbnail(picture: &RgbImage, wireframe: &Wireframe, nodes: &[TrackedNode], height: u32) -> RgbImage {
    let positions = || nodes.iter().map(|n| n.position);
    let (mut low, mut high) = (Point2::new(f64::INFINITY, f64::INFINITY), Point2::new(f64::NEG_INFINITY, f64::NEG_INFINITY));
    positions().for_each(|p| (low, high) = (low.inf(&p), high.sup(&p)));
    let margin = 0.08 * (high.y - low.y).max(1.0);
    let clip = |v: f64, most: u32| if v.is_finite() { v.clamp(0.0, f64::from(most)) as u32 } else { 0 };
    let (left, top) = (clip(low.x - margin, picture.width()), clip(low.y - margin, picture.height()));
    let (right, bottom) = (clip(high.x + margin, picture.width()), clip(high.y + margin, picture.height()));
    let (width, rows) = (right.saturating_sub(left).max(1), bottom.saturating_sub(top).max(1));
    let scale = f64::from(height) / f64::from(rows);
    let columns = ((f64::from(width) * scale).round() as u32).clamp(1, 2 * height);
    let cut = image::imageops::crop_imm(picture, left, top, width, rows).to_image();
    let small = image::imageops::resize(&cut, columns, height, FilterType::Triangle);
    let Some(mut canvas) = Pixmap::new(columns, height) else { return small };
    for (pixel, rgb) in canvas.data_mut().chunks_exact_mut(4).zip(small.pixels()) {
        pixel.copy_from_slice(&[rgb.0[0], rgb.0[1], rgb.0[2], 255]);
    }
    let at = |p: &Point2<f64>| (((p.x + 0.5 - f64::from(left)) * scale) as f32, ((p.y + 0.5 - f64::from(top)) * scale) as f32);
    if let Some(path) = springs(wireframe, nodes, at) {
        stroke(&mut canvas, &path, [120, 230, 180, 190], 0.8);
    }
    for &id in wireframe.live_nodes() {
        if let Some(node) = nodes.get(id.index())
            && node.state.loss().is_some()
        {
            let (x, y) = at(&node.position);
            dot(&mut canvas, x, y, 1.8, colour(node.state));
        }
    }
    let rgb = canvas.data().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    RgbImage::from_raw(columns, height, rgb).unwrap_or(small)
}

/// Draws detected points with their expected error (px); the third value is the eye distance of their face (px). Dots are green for an expected
/// error up to 2 % of the eye distance, yellow up to 5 %, and red beyond. Small pictures are enlarged.
pub fn draw_points(gray: &image::GrayImage, points: &[(Point2<f64>, f64, f64)]) -> RgbImage {
    let factor = MIN_WIDTH.div_ceil(gray.width().max(1)).clamp(1, MAX_FACTOR);
    let large = image::imageops::resize(gray, gray.width() * factor, gray.height() * factor, FilterType::CatmullRom);
    let Some(mut canvas) = Pixmap::new(large.width(), large.height()) else {
        return colour_of(&large);
    };
    for (pixel, luma) in canvas.data_mut().chunks_exact_mut(4).zip(large.as_raw()) {
        pixel.copy_from_slice(&[*luma, *luma, *luma, 255]);
    }
    let scale = f64::from(factor);
    for (point, expected_error, eye_distance) in points {
        let (x, y) = (((point.x + 0.5) * scale) as f32, ((point.y + 0.5) * scale) as f32);
        let radius = ((0.012 * eye_distance * scale) as f32).max(1.5);
        let share = expected_error / eye_distance;
        let colour = if share <= 0.02 {
            [60, 220, 90]
        } else if share <= 0.05 {
            [240, 228, 66]
        } else {
            [230, 60, 40]
        };
        dot(&mut canvas, x, y, radius * 1.4, [10, 20, 30]);
        dot(&mut canvas, x, y, radius, colour);
    }
    let rgb = canvas.data().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    RgbImage::from_raw(large.width(), large.height(), rgb).unwrap_or_default()
}

fn paint(rgba: [u8; 4]) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color(Color::from_rgba8(rgba[0], rgba[1], rgba[2], rgba[3]));
    paint.anti_alias = true;
    paint
}

/// Path of the springs between tracked nodes, at the positions given by `at`.
fn springs(wireframe: &Wireframe, nodes: &[TrackedNode], at: impl Fn(&Point2<f64>) -> (f32, f32)) -> Option<tiny_skia::Path> {
    let mut springs = PathBuilder::new();
    for (a, b) in wireframe.edges() {
        if let (Some(a), Some(b)) = (nodes.get(a.index()), nodes.get(b.index())) {
            let ((ax, ay), (bx, by)) = (at(&a.position), at(&b.position));
            springs.move_to(ax, ay);
            springs.line_to(bx, by);
        }
    }
    springs.finish()
}

fn stroke(canvas: &mut Pixmap, path: &SkiaPath, rgba: [u8; 4], width: f32) {
    let stroke = Stroke { width, line_cap: LineCap::Round, ..Stroke::default() };
    canvas.stroke_path(path, &paint(rgba), &stroke, Transform::identity(), None);
}

fn dot(canvas: &mut Pixmap, x: f32, y: f32, radius: f32, [r, g, b]: [u8; 3]) {
    if let Some(circle) = PathBuilder::from_circle(x, y, radius) {
        canvas.fill_path(&circle, &paint([r, g, b, 255]), FillRule::Winding, Transform::identity(), None);
    }
}

/// Encodes a picture as PNG.
///
/// # Errors
/// If the encoder fails, which it does only when out of memory.
pub fn png_bytes<P>(picture: &ImageBuffer<P, Vec<u8>>) -> Result<Vec<u8>, image::ImageError>
where
    P: PixelWithColorType<Subpixel = u8>,
{
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tracked_node_is_a_dot_of_its_colour_at_its_place() {
        let frame = Frame::new(1, image::GrayImage::from_pixel(500, 400, image::Luma([128])));
        let wireframe = Wireframe::candide3();
        let nodes: Vec<_> = wireframe
            .vertices()
            .iter()
            .map(|v| TrackedNode::new(Point2::new(250.0 + 150.0 * v.x, 200.0 - 150.0 * v.y), NodeState::Tracked, None))
            .collect();
        let picture = draw_overlay(&frame, &wireframe, &nodes, &[]);
        assert_eq!(picture.dimensions(), (1000, 800));
        // Node 10, chin: (250, 200 + 150 * 0.852) = (250, 327.8), doubled with the half-pixel shift: (501, 656.6).
        assert_eq!(picture.get_pixel(500, 656).0, colour(NodeState::Tracked));
        assert_eq!(picture.get_pixel(5, 5).0, [128, 128, 128]);
    }
}
