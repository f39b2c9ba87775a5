//! `klt LEVELS WINDOW`: receives grey frames one by one, and tracks points from one to another. Pyramids are built once per frame and used
//! as next, then as previous image.

use std::{ffi::OsString, rc::Rc};

use grimace::internal::companion::wire::{Pixels, Reply, Request};
use opencv::{
    core::{BORDER_CONSTANT, BORDER_REFLECT_101, Mat, Point2f, Size, TermCriteria, TermCriteria_Type, Vector},
    video::{OPTFLOW_USE_INITIAL_FLOW, build_optical_flow_pyramid, calc_optical_flow_pyr_lk},
};

use crate::{
    Trouble, number,
    talk::{Heard, Talk},
};

/// Largest number of iterations, and step (px) below which the search at one pyramid level ends: OpenCV's defaults.
const MAX_ITERATIONS: i32 = 30;
const STEP_PX: f64 = 0.01;

/// Smallest normalized eigenvalue of a window's gradient matrix: OpenCV's default.
const MIN_EIGENVALUE: f64 = 1e-4;

/// Frames as pyramids: neutral, previous, current. They are shared rather than cloned: a cloned `Mat` loses its pyramid's padding.
type Frames = [Rc<Vector<Mat>>; 3];

pub fn run(arguments: &[OsString], talk: &mut Talk) -> Result<(), Trouble> {
    let levels = number::<i32>(arguments, 0)?.clamp(1, 8);
    let max_window = number::<i32>(arguments, 1)?.clamp(3, 255);
    let mut frames = Frames::default();
    loop {
        match talk.hear()? {
            Heard::Picture(pixels) => {
                let current = Rc::new(pyramid(&pixels, levels, max_window)?);
                if frames[0].is_empty() {
                    frames[0] = Rc::clone(&current);
                }
                frames[1] = std::mem::replace(&mut frames[2], current);
                talk.say(&Reply::Ready)?;
            }
            Heard::Asked(Request::Find { from, to, window, levels: wanted, points, guesses }) => {
                let size = (window.min(255) as i32).clamp(3, max_window);
                let found = find(
                    [from, to].map(|slot| &*frames[usize::from(slot).min(2)]),
                    (Size::new(size, size), (wanted.min(8) as i32).clamp(1, levels)),
                    &points,
                    &guesses,
                )?;
                talk.say(&Reply::Found(found))?;
            }
            Heard::Asked(Request::End) | Heard::Nothing => return Ok(()),
        }
    }
}

fn pyramid(pixels: &Pixels, levels: i32, max_window: i32) -> Result<Vector<Mat>, Trouble> {
    let mut pyramid = Vector::<Mat>::new();
    let mat = Mat::new_rows_cols_with_data(pixels.height as i32, pixels.width as i32, &pixels.data)?;
    let window = Size::new(max_window, max_window);
    // The pyramid copies the frame, which can be dropped.
    build_optical_flow_pyramid(&mat, &mut pyramid, window, levels - 1, true, BORDER_REFLECT_101, BORDER_CONSTANT, false)?;
    Ok(pyramid)
}

fn find(
    [from, to]: [&Vector<Mat>; 2],
    (window, levels): (Size, i32),
    points: &[[f32; 2]],
    guesses: &[[f32; 2]],
) -> Result<Vec<Option<[f32; 3]>>, Trouble> {
    let list = |points: &[[f32; 2]]| points.iter().map(|p| Point2f::new(p[0], p[1])).collect::<Vector<Point2f>>();
    let (points, mut found) = (list(points), list(guesses));
    let (mut status, mut error) = (Vector::<u8>::new(), Vector::<f32>::new());
    let kind = TermCriteria_Type::COUNT as i32 + TermCriteria_Type::EPS as i32;
    let criteria = TermCriteria { typ: kind, max_count: MAX_ITERATIONS, epsilon: STEP_PX };
    calc_optical_flow_pyr_lk(
        from,
        to,
        &points,
        &mut found,
        &mut status,
        &mut error,
        window,
        levels - 1,
        criteria,
        OPTFLOW_USE_INITIAL_FLOW,
        MIN_EIGENVALUE,
    )?;
    let answers = found.iter().zip(status.iter()).zip(error.iter());
    Ok(answers
        .map(|((point, status), error)| {
            let is_found = status == 1 && point.x.is_finite() && point.y.is_finite() && error.is_finite();
            is_found.then_some([point.x, point.y, error])
        })
        .collect())
}
