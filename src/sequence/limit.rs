//! Limits the size of pictures that are decoded. A file of a few kilobytes can state a size that fills the memory; its header is checked
//! first.

use std::sync::atomic::{AtomicU64, Ordering};

use super::{DecodeError, ImageSize};

/// Default for the largest picture that is decoded, in pixels (see [`set_max_pixels`]): four frames of 8K video. It exceeds the pictures of
/// any camera with up to 102 megapixels, and the largest grey frame takes 128 MB.
pub const DEFAULT_MAX_PIXELS: u64 = 128_000_000;

static MAX_PIXELS: AtomicU64 = AtomicU64::new(DEFAULT_MAX_PIXELS);

/// Sets the largest picture or video frame, in pixels, that this process decodes.
pub fn set_max_pixels(pixels: u64) {
    MAX_PIXELS.store(pixels, Ordering::Relaxed);
}

/// Largest picture or video frame, in pixels, that this process decodes.
#[must_use]
pub fn max_pixels() -> u64 {
    MAX_PIXELS.load(Ordering::Relaxed)
}

/// Checks a size stated in a header before memory for it is allocated.
pub(super) fn check_size(width: u32, height: u32) -> Result<(), DecodeError> {
    let most = max_pixels();
    if u64::from(width) * u64::from(height) > most {
        return Err(DecodeError::TooLarge { size: ImageSize { width, height }, most });
    }
    if width == 0 || height == 0 {
        return Err(DecodeError::NoPixels { size: ImageSize { width, height } });
    }
    Ok(())
}
