//! Settings of OpenCV that results and the terminal depend on, made by whatever needs OpenCV.

use std::sync::Once;

/// Makes OpenCV quiet and single-threaded: rayon spreads the work over sequences, and results must not depend on threads.
pub(crate) fn configure() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // Each of them only fails by an exception that it does not throw; a louder or slower OpenCV computes the same.
        let _ = opencv::core::set_log_level(opencv::core::LogLevel::LOG_LEVEL_SILENT);
        let _ = opencv::core::set_use_opencl(false);
        let _ = opencv::core::set_num_threads(1);
    });
}
